"""How litegripctl stops: by the socket for stops, else as any other request."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from litegrip_client import ConnectError, ProtocolError
from litegrip_client.core.sockets import stop_path
from litegrip_client.core.stop import stop_at
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import Ctl


@pytest.fixture
def stops(daemon: FakeDaemon) -> Iterator[FakeDaemon]:
    """Return what listens where stops are taken."""
    with FakeDaemon(Path(stop_path(daemon.path))) as listening:
        yield listening


def test_a_stop_goes_by_the_socket_that_is_served_first(
    daemon: FakeDaemon, stops: FakeDaemon, ctl: Ctl
) -> None:
    stops.handlers["stop"] = lambda request: {"level": request.params["level"], "generation": 4}
    text = "stopped: relax, until: litegripctl clear\n"
    assert ctl("stop", "--level", "relax", "--why", "a hand") == (0, text, "")
    assert [one.params for one in stops.requests] == [{"level": "relax", "why": "a hand"}]
    assert daemon.methods() == []  # nothing waits behind other requests


def test_a_reason_that_would_be_cut_with_its_level_goes_the_other_way(
    daemon: FakeDaemon, stops: FakeDaemon, ctl: Ctl
) -> None:
    answer = {"level": "disable", "generation": 4, "state": STATE}
    daemon.handlers["stop"] = lambda request: answer
    assert ctl("stop", "--level", "disable", "--why", "x" * 2000)[0] == 0
    assert stops.methods() == []
    assert daemon.requests[-1].params == {"level": "disable", "why": "x" * 2000}


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), TimeoutError()])
def test_who_cannot_reach_that_socket_is_told_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, litegripctl: Ctl, error: OSError
) -> None:
    def refuse(*_arguments: object) -> None:
        raise error

    monkeypatch.setattr("litegrip_client.ctl.commands.state.stop_at", refuse)
    code, _, err = litegripctl("--socket", str(tmp_path / "x.sock"), "stop")
    assert (code, "no daemon can be reached" in err) == (3, True)


@pytest.mark.parametrize("answer", [b"", b"[]\n", b"{}\n"])
def test_an_answer_that_is_none_is_told(
    daemon: FakeDaemon, stops: FakeDaemon, answer: bytes
) -> None:
    def hang_up(request: Request) -> None:
        request.send_bytes(answer)
        request.hang_up()

    stops.handlers["stop"] = hang_up
    with pytest.raises(ProtocolError):
        stop_at(daemon.path, "hold", None, 5.0)


def test_an_answer_that_does_not_come_is_told(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(tmp_path / "x.stop.sock"))
        listener.listen()
        with pytest.raises(ConnectError, match="its answer did not come"):
            stop_at(str(tmp_path / "x.sock"), "hold", None, 0.01)
