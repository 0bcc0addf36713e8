"""The commands of litegripctl for clients, the lease and the stop."""

import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import ConnectError, ProtocolError
from litegrip_client.core.sockets import stop_path
from litegrip_client.core.stop import stop_at
from litegrip_client.ctl.main import main
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import STATE, FakeDaemon
from tests.client.helpers import Ctl

HOLDER = {"client": 4, "pid": 77, "uid": 1000, "program": "sorter.py", "purpose": "sorting"}


def taking(daemon: FakeDaemon, owner: Any, job: int | None, **state: Any) -> None:
    """Let a daemon answer a take-over so."""
    answer = {"lease": "e", "number": 2, "ended_job": job, "state": {**STATE, **state}}
    daemon.handlers["lease.get"] = lambda request: {"owner": owner, "mine": False, "waiting": 0}
    daemon.handlers["lease.take"] = lambda request: answer


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("\n", 1), ("\x04", 1)])
def test_a_take_over_on_a_terminal_asks_first(daemon: FakeDaemon, answer: str, code: int) -> None:
    taking(daemon, HOLDER, None)
    terminal = Terminal("--socket", daemon.path, "lease", "take", "it hangs")
    what = "sorter.py (pid 77), uid 1000, has it for sorting"
    terminal.expect(f"{what}; end that? The jaws hold on then. [y/N] ")
    assert "lease.take" not in daemon.methods()
    terminal.type(answer)
    assert terminal.end()[0] == code
    assert ("lease.take" in daemon.methods()) is (code == 0)


def test_a_take_over_on_a_terminal_asks_for_a_motion_without_a_lease_too(
    daemon: FakeDaemon,
) -> None:
    taking(daemon, None, 3)
    job = {"job": 3, "kind": "open", "phase": None, "owner": {"program": "a.py", "pid": 5}}
    daemon.handlers["state.get"] = lambda request: {**STATE, "job": job}
    terminal = Terminal("--socket", daemon.path, "lease", "take", "--release", "it hangs")
    terminal.expect("job 3, open by a.py (pid 5), is running; end that? The jaws go slack then.")
    terminal.type("y\n")
    assert terminal.end()[0] == 0


@pytest.mark.parametrize("owner", [None, HOLDER])
def test_a_take_over_asks_nothing_where_there_is_nothing_to_end_or_it_is_told_not_to(
    daemon: FakeDaemon, owner: Any
) -> None:
    taking(daemon, owner, None)
    yes = [] if owner is None else ["--yes"]
    terminal = Terminal("--socket", daemon.path, "lease", "take", *yes, "it hangs")
    code, shown = terminal.end()
    assert (code, "[y/N]" in shown) == (0, False)


class StopSocket:
    """Listens where stops are taken; answers one with `answer`, or hangs up."""

    def __init__(self, path: Path, answer: bytes) -> None:
        self.received = b""
        self._answer = answer
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        self._listener.listen()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        peer, _ = self._listener.accept()
        with peer:
            while not self.received.endswith(b"\n"):
                self.received += peer.recv(4096)
            peer.sendall(self._answer)

    @property
    def request(self) -> dict[str, Any]:
        self._thread.join()
        request: dict[str, Any] = json.loads(self.received)
        return request

    def close(self) -> None:
        self._listener.close()
        self._thread.join()


DONE = b'{"jsonrpc":"2.0","id":1,"result":{"level":"relax","generation":4}}\n'


@pytest.fixture
def stops(daemon: FakeDaemon) -> Iterator[StopSocket]:
    listening = StopSocket(Path(stop_path(daemon.path)), DONE)
    yield listening
    listening.close()


def test_a_stop_goes_by_the_socket_that_is_served_first(
    daemon: FakeDaemon, stops: StopSocket, ctl: Ctl
) -> None:
    text = "stopped: relax, until: litegripctl clear\n"
    assert ctl("stop", "--level", "relax", "--why", "a hand") == (0, text, "")
    assert stops.request["params"] == {"level": "relax", "why": "a hand"}
    assert daemon.methods() == []  # nothing waits behind other requests


def test_a_daemon_without_that_socket_is_stopped_all_the_same(daemon: FakeDaemon, ctl: Ctl) -> None:
    answer = {"level": "hold", "generation": 4, "state": STATE}
    daemon.handlers["stop"] = lambda request: answer
    assert ctl("stop")[0] == 0
    assert daemon.methods() == ["hello", "stop"]


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), TimeoutError()])
def test_who_cannot_reach_that_socket_is_told_in_a_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: OSError,
) -> None:
    def refuse(*_arguments: object) -> None:
        raise error

    monkeypatch.setattr("litegrip_client.ctl.commands.state.stop_at", refuse)
    assert main(["--socket", str(tmp_path / "x.sock"), "stop"]) == 3
    assert "no daemon can be reached" in capsys.readouterr().err


def test_a_reason_that_would_be_cut_with_its_level_goes_the_other_way(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    answer = {"level": "disable", "generation": 4, "state": STATE}
    daemon.handlers["stop"] = lambda request: answer
    with FakeDaemon(Path(stop_path(daemon.path))) as stops:
        assert ctl("stop", "--level", "disable", "--why", "x" * 2000)[0] == 0
        assert stops.methods() == []
    assert daemon.requests[-1].params == {"level": "disable", "why": "x" * 2000}


@pytest.mark.parametrize(
    ("answer", "error"),
    [(b"", ProtocolError), (b"[]\n", ProtocolError), (b"{}\n", ProtocolError)],
)
def test_an_answer_that_is_none_is_told(
    tmp_path: Path, answer: bytes, error: type[Exception]
) -> None:
    listening = StopSocket(tmp_path / "x.stop.sock", answer)
    with pytest.raises(error):
        stop_at(str(tmp_path / "x.sock"), "hold", None, 5.0)
    listening.close()


def test_an_answer_that_does_not_come_is_told(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(tmp_path / "x.stop.sock"))
        listener.listen()
        with pytest.raises(ConnectError, match="its answer did not come"):
            stop_at(str(tmp_path / "x.sock"), "hold", None, 0.01)
