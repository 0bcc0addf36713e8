"""The dead man's switch and its daemon, which is a socket here: what is sent until one confirms."""

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.core.sockets import SOCKET_VARIABLE, stop_path
from litegrip_fleet.far import daemon
from litegrip_fleet.far.dead_man import DeadMansSwitch
from litegrip_fleet.wire.keys import Place

DEADLINE_S = 20.0
CONFIRMED = b'{"jsonrpc":"2.0","id":1,"result":{}}\n'
REFUSED = b'{"jsonrpc":"2.0","id":1,"error":{"code":-32603,"message":"no"}}\n'


@pytest.fixture
def stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A daemon of which only the socket for stops is there."""
    path = str(tmp_path / "left.sock")
    monkeypatch.setenv(SOCKET_VARIABLE, path)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.settimeout(DEADLINE_S)
        listening.bind(stop_path(path))
        listening.listen()
        yield listening


@pytest.fixture
def switch(stops: socket.socket) -> Iterator[DeadMansSwitch]:
    switch = DeadMansSwitch({Place("lab", "left"): "left"}, ["op1"], "relax")
    with switch.running():
        yield switch
    switch._loop.close()


def stop_on(stops: socket.socket, answer: bytes) -> dict[str, Any]:
    """Take the next stop and answer it; return what it asks for."""
    connected, _ = stops.accept()
    with connected, connected.makefile("rb") as lines:
        connected.settimeout(DEADLINE_S)
        request: dict[str, Any] = json.loads(lines.readline())
        connected.sendall(answer)
    assert request["method"] == "stop"
    params: dict[str, Any] = request["params"]
    return params


@pytest.mark.parametrize("answer", [b"", b"what?\n", REFUSED])
def test_until_the_daemon_confirms_it_a_stop_is_sent_again_though_the_user_is_back(
    stops: socket.socket, switch: DeadMansSwitch, answer: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    first = stop_on(stops, answer)
    assert first == {"level": "relax", "why": "op1 is silent, and has to be present"}
    switch.shown("op1", time.monotonic(), 60.0)
    while stop_on(stops, answer)["why"] != "op1 was silent, and has to be present":
        pass
    assert "stopped (" not in caplog.text
    assert stop_on(stops, CONFIRMED)["level"] == "relax"
    assert [record.message for record in caplog.records if "NOT stopped" in record.message]


def test_others_show_nothing(stops: socket.socket, switch: DeadMansSwitch) -> None:
    switch.shown("op2", time.monotonic(), 60.0)
    stop_on(stops, b"")
    assert stop_on(stops, CONFIRMED)["why"] == "op1 is silent, and has to be present"


def test_a_switch_that_fails_says_so_to_who_runs_it(
    stops: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def broken(channel: str, level: str, why: str) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(daemon, "stop", broken)
    switch = DeadMansSwitch({Place("lab", "left"): "left"}, ["op1"], "relax")
    with switch.running() as watching, pytest.raises(ZeroDivisionError):
        watching.result(DEADLINE_S)
    switch._loop.close()
