"""The stop socket: whatever is said to it stops, whoever floods it, and nobody is waited for."""

import contextlib
import errno
import json
import os
import select
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.io.loop import Urgent
from litegripd.io.sockets import listen
from litegripd.io.stop_socket import (
    MAX_STOP_CONNECTIONS,
    MAX_STOP_LINE_BYTES,
    Latched,
    StopListener,
)
from litegripd.model.state import STOP_LEVELS, Owner, StopLevel
from litegripd.rpc.jsonrpc import StopLine, stop_in

GENEROUS_S = 100.0  # as a period: a tenth of it serves everything that is there
Stopped = tuple[StopLevel, Owner, str | None]


def latched(level: StopLevel, generation: int) -> dict[str, object]:
    """Return the answer to a stop."""
    return {"level": level, "generation": generation, "motor": "enabled"}


class Socket:
    """A stop socket whose stops are noted; `serve` is what the daemon does in a tick."""

    def __init__(self, path: Path, period_s: float) -> None:
        self.path = path
        self.gateways: set[int] = set()
        self.stops: list[Stopped] = []
        self.defect: Exception | None = None
        self.urgent = Urgent(period_s)
        self.listener = StopListener(
            self.urgent, listen(path, None), self._stop, lambda peer: peer.uid in self.gateways
        )
        self._clients: list[socket.socket] = []

    def _stop(self, level: StopLevel, by: Owner, why: str | None) -> Latched:
        if self.defect is not None:
            raise self.defect
        self.stops.append((level, by, why))
        return Latched(level, len(self.stops), "enabled")

    @property
    def levels(self) -> list[StopLevel]:
        return [level for level, _by, _why in self.stops]

    def serve(self) -> None:
        self.urgent.serve()

    def connect(self) -> socket.socket:
        client = socket.socket(socket.AF_UNIX)
        self._clients.append(client)
        client.connect(str(self.path))
        client.setblocking(False)
        return client

    def say(self, said: bytes) -> socket.socket:
        """Connect, send, and be served."""
        client = self.connect()
        client.send(said)
        self.serve()
        return client

    def close(self) -> None:
        for client in self._clients:
            client.close()
        self.listener.close()
        self.urgent.close()


@contextlib.contextmanager
def stop_socket(folder: Path, period_s: float) -> Iterator[Socket]:
    made = Socket(folder / "x.stop.sock", period_s)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def stops(tmp_path: Path) -> Iterator[Socket]:
    with stop_socket(tmp_path, GENEROUS_S) as made:
        yield made


@pytest.fixture
def one_at_a_time(tmp_path: Path) -> Iterator[Socket]:
    """With no time at all, one descriptor is served each time."""
    with stop_socket(tmp_path, 0.0) as made:
        yield made


def answers(client: socket.socket) -> list[dict[str, Any]]:
    """Return what a client has been sent."""
    return [json.loads(line) for line in client.recv(1 << 20).splitlines()]


def is_closed(client: socket.socket) -> bool:
    """True if the daemon has closed a connection whose answers have been read."""
    try:
        return client.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def request(**params: Any) -> bytes:
    return json.dumps({"jsonrpc": "2.0", "id": 7, "method": "stop", "params": params}).encode()


LINES: dict[bytes, StopLine] = {
    b"hold": StopLine("hold"),
    b"relax": StopLine("relax"),
    b" DISABLE\r": StopLine("disable"),
    b"": StopLine("hold"),
    b"stop!": StopLine("hold", "stop!"),
    "der Finger ist drin, schön".encode(): StopLine("hold", "der Finger ist drin, schön"),
    b"a\x1b[31m": StopLine("hold"),
    b"x" * 500: StopLine("hold", "x" * 80),
    request(): StopLine("hold", None, 7),
    request(on_behalf="op1@lab"): StopLine("hold", None, 7, "op1@lab"),
    request(on_behalf=["op1"], why=1): StopLine("hold", None, 7),
    request(level="relax"): StopLine("relax", None, 7),
    request(level="disable", why="smoke"): StopLine("disable", "smoke", 7),
    request(level="disable", sent_s=1.0, more=[1]): StopLine("disable", None, 7),
    request(level="slack"): StopLine("hold", None, 7),
    request(level=["disable"]): StopLine("hold", None, 7),
    request(why="a\nb"): StopLine("hold", None, 7),
    request(why="\ud800"): StopLine("hold", None, 7),
    request(why=3): StopLine("hold", None, 7),
    b'{"jsonrpc":"2.0","method":"stop","params":{"level":"relax"}}': StopLine("relax"),
    b'{"jsonrpc":"2.0","id":"a","method":"state.get"}': StopLine(
        "hold", '{"jsonrpc":"2.0","id":"a","method":"state.get"}', "a"
    ),
    b'{"id":5,"method":"stop"}': StopLine("hold", None, 5),
    b'{"id":5,"method":"stop","params":{"level":"disable"}}': StopLine("disable", None, 5),
    b"[" * 1000: StopLine("hold", "[" * 80),
}


@pytest.mark.parametrize("line", LINES)
def test_every_line_is_a_stop(line: bytes) -> None:
    assert stop_in(line) == LINES[line]


@given(st.binary(max_size=200) | st.text(max_size=50).map(lambda t: request(level=t, why=t)))
def test_whatever_the_bytes_are_they_stop(line: bytes) -> None:
    stop = stop_in(line)
    assert stop.level in STOP_LEVELS
    assert stop.why is None or (0 < len(stop.why) <= 80 and stop.why.isprintable())


def test_a_stop_is_answered_with_the_id_the_level_and_the_generation(stops: Socket) -> None:
    client = stops.say(request(level="relax", why="smoke") + b"\n")
    assert answers(client) == [
        {
            "jsonrpc": "2.0",
            "id": 7,
            "result": latched("relax", 1),
        }
    ]
    client.send(b"disable\n")
    stops.serve()
    assert answers(client) == [
        {
            "jsonrpc": "2.0",
            "id": None,
            "result": latched("disable", 2),
        }
    ]
    assert stops.levels == ["relax", "disable"]


def test_who_stops_is_told_by_the_kernel(stops: Socket) -> None:
    stops.say(request(why="smoke") + b"\n")
    comm = Path("/proc/self/comm").read_text(encoding="utf-8").strip()
    assert stops.stops == [("hold", Owner(0, os.getpid(), os.getuid(), comm), "smoke")]


def test_who_says_nothing_stops_nothing(stops: Socket) -> None:
    quiet, gone = stops.connect(), stops.connect()
    gone.close()
    stops.serve()
    assert stops.listener.connections == 1
    quiet.close()
    stops.serve()
    assert stops.listener.connections == 0
    assert stops.stops == []


def test_a_stop_that_was_sent_by_a_client_that_is_gone_counts(stops: Socket) -> None:
    client = stops.connect()
    client.send(b"disable\n")
    client.close()
    stops.serve()
    assert stops.levels == ["disable"]
    assert stops.listener.connections == 0


def test_a_line_may_come_in_pieces(stops: Socket) -> None:
    client = stops.say(b"rel")
    assert stops.stops == []
    client.send(b"ax")
    stops.serve()
    assert stops.stops == []
    client.send(b"\n")
    stops.serve()
    assert stops.levels == ["relax"]


def test_an_end_without_a_newline_is_one(stops: Socket) -> None:
    client = stops.say(b"disable")
    client.shutdown(socket.SHUT_WR)
    stops.serve()
    assert stops.levels == ["disable"]
    assert answers(client)[0]["result"] == latched("disable", 1)
    assert is_closed(client)


def test_half_a_request_of_a_client_that_died_is_a_stop(stops: Socket) -> None:
    stops.say(request(level="relax")[:30]).close()
    stops.serve()
    assert stops.levels == ["hold"]


def test_half_a_line_of_a_client_that_left_answers_unread_is_a_stop(stops: Socket) -> None:
    client = stops.say(b"relax\n")
    client.send(b"hol")
    client.close()  # the kernel tells the daemon of a reset
    stops.serve()
    stops.serve()
    assert stops.levels == ["relax", "hold"]
    assert stops.listener.connections == 0


def test_a_kibibyte_without_a_newline_is_a_stop_at_once(stops: Socket) -> None:
    client = stops.say(b"x" * (MAX_STOP_LINE_BYTES - 1))
    assert stops.stops == []
    client.send(b"xx")
    stops.serve()
    assert stops.levels == ["hold"]
    assert answers(client)[0]["result"] == latched("hold", 1)
    assert is_closed(client)


def test_many_lines_in_one_packet_are_answered_in_order(stops: Socket) -> None:
    client = stops.say(b"hold\n\nrelax\n" + request() + b"\ndisable")
    assert [answer["result"]["level"] for answer in answers(client)] == [
        "hold",
        "hold",
        "relax",
        "hold",
    ]
    client.close()
    stops.serve()
    assert stops.levels == ["hold", "hold", "relax", "hold", "disable"]


def test_a_flood_keeps_nobody_waiting(one_at_a_time: Socket) -> None:
    stops = one_at_a_time
    floods = [stops.connect() for _ in range(3)]
    for flood in floods:
        stops.serve()
        flood.send(b"hold\n" * 1000)
    other = stops.connect()
    other.send(b"disable\n")
    turns = 0
    while "disable" not in stops.levels:
        stops.serve()
        turns += 1
        assert turns <= 2 * (len(floods) + 1)  # one for each, and one more to let it in


def test_a_turn_takes_no_more_than_its_share(one_at_a_time: Socket) -> None:
    client = one_at_a_time.say(b"hold\n" * 10)
    for count in range(1, 11):
        assert one_at_a_time.levels == ["hold"] * count
        one_at_a_time.serve()
    assert len(answers(client)) == 10


def test_nobody_is_waited_for_who_does_not_read_the_answers(stops: Socket) -> None:
    deaf = stops.connect()
    sent = 0
    for _ in range(100):
        sent += deaf.send(b"relax\n" * 100) // len(b"relax\n")
        stops.serve()
    assert len(stops.stops) == sent == 10_000
    other = stops.say(b"hold\n")
    assert answers(other)[0]["result"]["generation"] == sent + 1


def test_who_was_idle_the_longest_gives_way_to_a_newcomer(stops: Socket) -> None:
    first, second, *others = (stops.connect() for _ in range(MAX_STOP_CONNECTIONS))
    stops.serve()
    first.send(b"hold\n")
    stops.serve()
    newcomer = stops.say(b"relax\n")
    assert stops.levels == ["hold", "relax"]
    assert answers(newcomer)[0]["result"]["level"] == "relax"
    (reason,) = answers(second)
    assert reason["error"]["data"]["reason"] == "too_many_connections"
    assert is_closed(second)
    first.send(b"hold\n")
    others[0].send(b"hold\n")
    stops.serve()
    assert len(stops.stops) == 4
    assert stops.listener.connections == MAX_STOP_CONNECTIONS


def test_half_a_line_of_who_gives_way_is_a_stop(stops: Socket) -> None:
    client = stops.say(b"relax")
    others = [stops.connect() for _ in range(MAX_STOP_CONNECTIONS - 1)]
    stops.serve()
    assert stops.stops == []
    stops.connect()
    stops.serve()
    assert stops.levels == ["relax"]
    assert answers(client)[0]["result"]["level"] == "relax"
    assert is_closed(client)
    assert not is_closed(others[0])


class Unlucky:
    """A listening socket whose next `accept` finds no descriptors left."""

    def __init__(self, real: socket.socket) -> None:
        self.real = real
        self.failures = 1

    def accept(self) -> tuple[socket.socket, Any]:
        if self.failures:
            self.failures -= 1
            raise OSError(errno.EMFILE, "too many open files")
        return self.real.accept()

    def fileno(self) -> int:
        return self.real.fileno()

    def close(self) -> None:
        self.real.close()


def test_without_descriptors_an_idle_connection_gives_its_own(
    stops: Socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    idle = stops.connect()
    stops.serve()
    monkeypatch.setattr(stops.listener, "_listener", Unlucky(stops.listener._listener))
    stops.say(b"relax\n")
    assert stops.levels == ["relax"]
    assert answers(idle)[0]["error"]["data"]["reason"] == "too_many_connections"
    assert stops.listener.connections == 1


def test_a_connection_that_cannot_be_watched_is_read_at_once(
    stops: Socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_fd: int, _handler: object) -> None:
        raise OSError(errno.ENOSPC, "no watches left")

    monkeypatch.setattr(stops.urgent, "add", refuse)
    client = stops.say(b"disable\n")
    assert stops.levels == ["disable"]
    assert answers(client)[0]["result"]["level"] == "disable"
    assert is_closed(client)


def test_a_defect_makes_nobody_deaf(stops: Socket, caplog: pytest.LogCaptureFixture) -> None:
    stops.defect = ZeroDivisionError("a defect")
    client, ending = stops.connect(), stops.connect()
    client.send(b"relax\nrelax\n")
    ending.send(b"relax")
    ending.close()
    stops.serve()
    assert stops.urgent.errors == 3
    assert [record.levelname for record in caplog.records] == ["ERROR"]
    assert stops.listener.connections == 1
    stops.defect = None
    client.send(b"hold\n")
    stops.serve()
    assert stops.levels == ["hold"]


def test_the_loop_is_told_of_a_stop_by_one_descriptor(stops: Socket) -> None:
    assert not select.select([stops.urgent], [], [], 0)[0]
    client = stops.connect()
    assert select.select([stops.urgent], [], [], 0)[0]
    stops.urgent.on_event(select.EPOLLIN)
    assert not select.select([stops.urgent], [], [], 0)[0]
    client.send(b"hold\n")
    assert select.select([stops.urgent], [], [], 0)[0]
    stops.urgent.on_event(select.EPOLLIN)
    assert stops.levels == ["hold"]
    assert not select.select([stops.urgent], [], [], 0)[0]


def test_closing_closes_all_connections(tmp_path: Path) -> None:
    with stop_socket(tmp_path, GENEROUS_S) as stops:
        client = stops.say(b"hold\n")
        answers(client)
        stops.listener.close()
        assert is_closed(client)
        assert stops.listener.connections == 0
        with pytest.raises(ConnectionRefusedError):
            stops.connect()


@pytest.mark.parametrize("is_gateway", [True, False])
def test_only_a_gateway_is_believed_on_whose_behalf_it_stops(
    stops: Socket, is_gateway: bool
) -> None:
    if is_gateway:
        stops.gateways.add(os.getuid())
    stops.say(request(level="relax", on_behalf="op1@lab") + b"\n")
    ((level, by, _why),) = stops.stops
    assert (level, by.uid, by.pid) == ("relax", os.getuid(), os.getpid())
    assert by.remote == ("op1@lab" if is_gateway else None)
    assert (by.program == "op1@lab via gateway") is is_gateway
