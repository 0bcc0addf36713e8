"""The stops' own thread: each gripper's in their order, none behind another's."""

import asyncio
import queue
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import litegrip_fleet.far.gateway as gateway_module
from litegrip_client.core.sockets import stop_path
from litegrip_fleet.far.daemon import told_to_stop
from litegrip_fleet.far.gateway import Gateway
from litegrip_fleet.far.together import Together
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import MOST_WAITING, Ring

WITHIN_S = 30.0
LEFT = Place("lab", "left")
NOTHING: Any = SimpleNamespace(session=None)


class Gripper:
    """A gripper that is stopped; its daemon does not answer the stop `hangs`."""

    def __init__(self, gateways: Together, hangs: object = None) -> None:
        self.stopped: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.coming: Ring[Any] = Ring(gateways.stop_loop, self._stop, MOST_WAITING)
        self._hangs = hangs

    async def _stop(self, query: Any) -> None:
        self.stopped.put(query)
        if query == self._hangs:
            await asyncio.Event().wait()
        if query == "strange":
            raise ValueError("strange")

    def next(self) -> Any:
        return self.stopped.get(timeout=WITHIN_S)


def test_stops_are_carried_out_in_their_order_whatever_becomes_of_one(
    caplog: pytest.LogCaptureFixture,
) -> None:
    gripper = Gripper(Together(NOTHING, LEFT))
    for _ in range(2):  # the second time after all was done
        for query in (1, "strange", 2):
            gripper.coming.put(query)
        assert [gripper.next() for _ in range(3)] == [1, "strange", 2]
    assert "what came was not taken" in caplog.text


def test_no_grippers_stop_waits_for_anothers() -> None:
    loop = Together(NOTHING, LEFT)
    hanging, other = Gripper(loop, hangs=1), Gripper(loop)
    hanging.coming.put(1)
    assert hanging.next() == 1
    hanging.coming.put(2)
    other.coming.put(1)
    assert other.next() == 1
    assert hanging.stopped.empty()


def test_of_a_flood_of_stops_the_newest_wait() -> None:
    gripper = Gripper(Together(NOTHING, LEFT), hangs="first")
    gripper.coming.put("first")
    assert gripper.next() == "first"
    for number in range(3 * MOST_WAITING):
        gripper.coming.put(number)
    assert list(gripper.coming._waiting) == list(range(2 * MOST_WAITING, 3 * MOST_WAITING))


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[socket.socket]:
    """A daemon's socket for stops, at which nobody answers by itself."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(stop_path(str(tmp_path / "can0.sock")))
        listener.listen()
        yield listener


def test_the_answer_of_a_daemon_may_come_in_pieces_or_not_at_all(
    tmp_path: Path, daemon: socket.socket
) -> None:
    def answer(*pieces: bytes) -> bytes:
        with daemon.accept()[0] as connected:
            line = connected.recv(100)
            for piece in pieces:
                connected.sendall(piece)
            return line

    async def scene(*pieces: bytes) -> tuple[bytes, bytes]:
        path = stop_path(str(tmp_path / "can0.sock"))
        given, answered = await asyncio.gather(
            told_to_stop(path, b"relax\n"), asyncio.to_thread(answer, *pieces)
        )
        return given, answered

    assert asyncio.run(scene(b'{"result"', b":{}}\n")) == (b'{"result":{}}\n', b"relax\n")
    assert asyncio.run(scene()) == (b"", b"relax\n")


def test_a_stop_that_a_daemon_does_not_answer_is_said_not_to_be_confirmed(
    tmp_path: Path, daemon: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = Gateway(NOTHING, LEFT, "can0", Together(NOTHING, LEFT))
    gateway._path = str(tmp_path / "can0.sock")
    monkeypatch.setattr(gateway_module, "STOP_WITHIN_S", 0.05)
    assert b"not confirmed by the daemon of can0" in asyncio.run(gateway._stopped(b"relax\n"))
    daemon.close()
    assert b"Connection refused" in asyncio.run(gateway._stopped(b"relax\n"))
