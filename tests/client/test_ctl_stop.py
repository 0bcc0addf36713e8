"""How litegripctl stops: by the socket for stops, else as any other request."""

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
from tests.client.fake_daemon import STATE, FakeDaemon
from tests.client.helpers import Ctl


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
