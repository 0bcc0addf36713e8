"""What a portal does with the stops of a client: each is given, once it is gone, too."""

import asyncio
import contextlib
import errno
import json
import os
import select
import socket
import time
from collections.abc import AsyncIterator
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
import zenoh

import litegrip_fleet.near.portal as portal_module
from litegrip_fleet.near.portal import (
    MOST_CLIENTS,
    MOST_STOP_CLIENTS,
    Portal,
    _Client,
    _process,
    _state_of,
)
from litegrip_fleet.near.together import Together
from litegrip_fleet.wire.daemon_lines import MAX_LINE_BYTES
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.messages import Ask, Reply
from litegrip_fleet.wire.together import Sample

ANSWER = b'{"jsonrpc":"2.0","id":null,"result":{"level":"hold","generation":1}}\n'


class Stopping(Portal):
    """A portal whose gripper is stopped by every line; `given` has them."""

    def __init__(self) -> None:
        place, path = Place("lab", "left"), Path("/nowhere/lab.left.sock")
        together = Together(lambda: None, "op1", "operator")
        super().__init__(
            lambda: None, place, path, together, user="op1", role="operator", ttl_s=1.0
        )
        self.given: list[bytes] = []

    async def _stopped(self, line: bytes) -> bytes:
        self.given.append(line)
        return ANSWER


def pair() -> tuple[socket.socket, socket.socket]:
    """Return a client's socket, and the portal's end of it."""
    client, connected = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    connected.setblocking(False)
    return client, connected


def given(*pieces: bytes) -> list[bytes]:
    """Return what is given for a client that sends this and goes at once."""
    client, connected = pair()
    for piece in pieces:
        client.sendall(piece)
    client.close()
    portal = Stopping()
    asyncio.run(portal._serve_stops(connected))
    return portal.given


def test_the_stops_of_a_client_that_goes_at_once_are_given() -> None:
    assert given(b"hold\nrelax\ndisable\n") == [b"hold\n", b"relax\n", b"disable\n"]
    assert given(b"hold\n", b"dis", b"able") == [b"hold\n", b"disable"]


def test_the_stops_of_a_client_that_has_left_its_answers_unread_are_given() -> None:
    client, connected = pair()
    portal = Stopping()

    async def go() -> None:
        client.sendall(b"hold\n")
        await asyncio.to_thread(select.select, (client,), (), ())
        client.sendall(b"relax\ndisable\n")
        client.close()

    async def both() -> None:
        await asyncio.gather(portal._serve_stops(connected), go())

    asyncio.run(both())
    assert portal.given == [b"hold\n", b"relax\n", b"disable\n"]


def test_who_is_gone_gives_each_kind_of_stop_once() -> None:
    given_now = given(b"hold\n" * 5000 + b"disable\n")
    assert given_now[-1] == b"disable\n"
    assert len(given_now) < 10


def test_who_reads_no_answers_is_stopped_for_all_the_same() -> None:
    client, connected = pair()
    client.setblocking(False)
    portal, lines = Stopping(), [b"hold\n"] * 20_000

    async def flood() -> None:
        loop = asyncio.get_running_loop()
        await loop.sock_sendall(client, b"".join(lines))
        client.shutdown(socket.SHUT_WR)

    async def both() -> None:
        await asyncio.gather(portal._serve_stops(connected), flood())

    asyncio.run(both())
    assert portal.given == lines
    client.close()


@pytest.mark.parametrize("count", [MAX_LINE_BYTES - 1, MAX_LINE_BYTES, 3 * MAX_LINE_BYTES])
def test_no_line_is_longer_than_a_message_can_be(count: int) -> None:
    lines = given(b"x" * count + b"\n")
    assert lines[0] == (b"x" * count + b"\n")[:MAX_LINE_BYTES]
    assert max(map(len, lines)) <= MAX_LINE_BYTES


def test_who_holds_connections_for_stops_gives_way_to_who_stops(tmp_path: Path) -> None:
    portal, path = Stopping(), str(tmp_path / "stop.sock")

    async def stop() -> bytes:
        """Fill it, send the begin of a line by the first, and stop by one more."""
        loop = asyncio.get_running_loop()
        with contextlib.ExitStack() as stack:
            listener = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            listener.bind(path)
            listener.listen(MOST_STOP_CLIENTS + 1)
            listener.setblocking(False)
            clients = []
            accepting = asyncio.create_task(portal._accept_stops(listener))
            for number in range(MOST_STOP_CLIENTS + 1):
                client = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
                client.setblocking(False)
                await loop.sock_connect(client, path)
                clients.append(client)
                await loop.sock_sendall(client, b"rel" if number == 0 else b"hold\n")
                if number > 0:
                    assert await asyncio.wait_for(loop.sock_recv(client, 4096), 10.0) == ANSWER
            assert await asyncio.wait_for(loop.sock_recv(clients[0], 4096), 10.0) == ANSWER
            ended = await asyncio.wait_for(loop.sock_recv(clients[0], 4096), 10.0)
            accepting.cancel()
            for task in list(portal._serving):
                task.cancel()
            await asyncio.gather(accepting, *portal._serving, return_exceptions=True)
            return ended

    assert asyncio.run(stop()) == b""
    assert portal.given.count(b"hold\n") == MOST_STOP_CLIENTS
    assert portal.given[-1] == b"rel"


def test_a_stop_by_a_request_that_the_network_has_lost_is_given_once_more() -> None:
    portal, (client, connected) = Stopping(), pair()
    stop = b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"disable"}}\n'
    motion = stop.replace(b"stop", b"motion.open").replace(b'"level":"disable"', b"")

    async def begin(one: _Client) -> None:  # there is no network: what is sent is lost
        one.begin(Reply(0, 0, time.monotonic()), time.monotonic(), time.monotonic())

    async def serve() -> None:
        reader, writer = await asyncio.open_unix_connection(sock=connected)
        with client:
            client.sendall(motion + stop)
        await portal._serve(reader, writer)
        writer.close()

    portal._open = begin  # type: ignore[method-assign, assignment]
    asyncio.run(serve())
    assert portal.given == [stop]


def test_no_more_programs_are_let_in_than_the_portal_has_descriptors_for() -> None:
    async def told() -> bytes:
        portal, (client, connected) = Stopping(), pair()
        portal._clients.update(dict.fromkeys(map(str, range(MOST_CLIENTS))))  # type: ignore[arg-type]
        reader, writer = await asyncio.open_unix_connection(sock=connected)
        with client:
            await portal._serve(reader, writer)
            writer.close()
            return client.recv(4096)

    assert json.loads(asyncio.run(told()))["error"]["data"]["reason"] == "too_many_connections"


def test_a_process_is_the_same_by_each_of_its_connections_and_no_other() -> None:
    own, parents = _process(os.getpid()), _process(os.getppid())
    assert own == _process(os.getpid()) != parents
    assert _process(0) != _process(0)


def test_a_portal_without_descriptors_goes_on_and_says_of_nobody_that_he_lives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert _state_of(os.getpid()) in ("R", "S")

    def none_left(*_arguments: object) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "open", none_left)
    assert _state_of(os.getpid()) == "T"


class Pouring:
    """Pushes of the gripper left without end, one of the gripper right, and the end of them."""

    def __init__(self, count: int) -> None:
        names = chain(repeat("left", count), ("right",), repeat("left", count), ("last",))
        self._keys = (f"litegripd/1/lab/{name}/to/op1/nobody" for name in names)
        self.handler = self

    def recv(self) -> object:
        for key in self._keys:
            return SimpleNamespace(key_expr=key)
        raise zenoh.ZError("undeclared")


def test_a_gripper_that_pushes_without_end_leaves_others_their_turn() -> None:
    session = SimpleNamespace(declare_subscriber=lambda *_arguments: Pouring(20_000))
    together = Together(lambda: cast("zenoh.Session", session), "op1", "operator")
    taken = {"left": 0, "right": 0, "last": 0}

    async def note(name: str, _sample: zenoh.Sample) -> None:
        taken[name] += 1

    for name in taken:
        together.pushed[Place("lab", name)] = partial(note, name)

    async def others() -> int:
        """Another gripper's work: it counts how many pushes are taken between two turns."""
        together.tick(0.0)
        before, most = 0, 0
        while not taken["last"]:
            await asyncio.sleep(0)
            most, before = max(most, taken["left"] - before), taken["left"]
        return most

    assert 0 < asyncio.run(asyncio.wait_for(others(), 60.0)) <= 64
    assert taken["right"] == 1


def test_what_is_sent_to_a_portal_is_heard_by_the_session_of_the_time() -> None:
    class Session:
        def __init__(self) -> None:
            self.heard = 0

        def declare_subscriber(self, _key: str, _queue: object) -> "Session":
            self.heard += 1
            return self

        @property
        def handler(self) -> "Session":
            return self

        def recv(self) -> None:
            raise zenoh.ZError("closed")

    sessions = [Session(), Session()]
    now: list[Session] = []

    async def tick() -> None:
        def session() -> zenoh.Session | None:
            return cast(zenoh.Session, now[-1]) if now else None

        together = Together(session, "op1", "operator")
        Portal(
            session,
            Place("lab", "left"),
            Path("/nowhere/lab.left.sock"),
            together,
            user="op1",
            role="operator",
            ttl_s=1.0,
        )
        together.tick(0.0)
        for one in sessions:
            now.append(one)
            together.tick(0.0)
            together.tick(0.0)

    asyncio.run(tick())
    assert [session.heard for session in sessions] == [1, 1]


# What is said of many sessions at once ------------------------------------------------------------

SAMPLE = b'{"jsonrpc":"2.0","method":"state.sample","params":{"subscription":1,"seq":1}}\n'
RIGHT = Place("lab", "right")


class Sending(Stopping):
    """A portal that notes what it sends by a session's own key."""

    def __init__(self) -> None:
        super().__init__()
        self.alone: list[Ask] = []

    def send_alone(self, client: _Client, message: Ask, line: bytes) -> None:
        assert (client.session, line) == ("s-1", b"")
        self.alone.append(message)


@contextlib.asynccontextmanager
async def begun(
    portal: Portal, about: dict[str, object]
) -> AsyncIterator[tuple[_Client, socket.socket]]:
    """Have a client whose session has begun at a gateway that says this of itself."""
    client, connected = pair()
    _reader, writer = await asyncio.open_unix_connection(sock=connected)
    key = portal.place.rpc("op1", "s-1", "operator")
    one = portal._clients["s-1"] = _Client(portal, "s-1", key, writer)
    one.begin(Reply(0, 0, time.monotonic(), about=about), time.monotonic(), time.monotonic())
    try:
        yield one, client
    finally:
        client.close()
        writer.close()
        await writer.wait_closed()


@pytest.mark.parametrize(
    ("about", "by", "is_taken"),
    [
        ({"together": "lab.right"}, RIGHT, True),
        ({"together": "lab.left"}, RIGHT, False),  # the gateway of another gripper says so
        ({"together": "other.right"}, Place("other", "right"), False),
        ({"together": "lab.*"}, RIGHT, False),
        ({"together": 7}, RIGHT, False),
        ({}, RIGHT, False),
    ],
)
def test_a_sample_is_taken_by_the_key_alone_that_its_own_gateway_has_named(
    about: dict[str, object], by: Place, is_taken: bool
) -> None:
    async def scene() -> bytes:
        portal = Sending()
        async with begun(portal, about) as (one, client):
            for session in ("s-1", "s-2"):
                portal._sampled(Sample("left", session, None, SAMPLE), by)
            one._to_client(b"end\n")
            return await asyncio.to_thread(client.recv, 4096)

    assert asyncio.run(scene()) == (SAMPLE if is_taken else b"") + b"end\n"


def test_only_a_sign_of_life_that_was_due_goes_together_with_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown: list[tuple[str, Ask]] = []
    due, behind = Ask("live", got=1), Ask("live", got=1, again=True)

    async def scene(about: dict[str, object]) -> list[Ask]:
        portal, together = Sending(), Together(lambda: None, "op1", "operator")
        portal.together = together
        monkeypatch.setattr(
            together, "shows", lambda one, _by, message: shown.append((one.session, message))
        )
        async with begun(portal, about) as (one, _client):
            portal.send(one, due, b"")  # not by a tick: 64 kB have come, which are to be confirmed
            together.is_ticking = True
            for message in (due, behind, Ask("eof", 1)):
                portal.send(one, message, b"")
        return portal.alone

    assert asyncio.run(scene({"together": "lab.left"})) == [due, behind, Ask("eof", 1)]
    assert shown == [("s-1", due)]
    assert asyncio.run(scene({})) == [due, due, behind, Ask("eof", 1)]
    assert len(shown) == 1


def test_the_state_of_a_process_is_looked_up_once_for_all_its_connections(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []

    def state_of(pid: int) -> str:
        looked.append(pid)
        return "R"

    monkeypatch.setattr(portal_module, "_state_of", state_of)

    async def scene() -> None:
        portal = Sending()
        async with begun(portal, {}) as (one, _client):
            portal._clients["s-2"] = one
            for _ in range(2):
                portal.together.tick(time.monotonic())

    asyncio.run(scene())
    assert looked == [os.getpid()] * 2


def test_clients_do_not_see_how_messages_of_many_go() -> None:
    async def scene() -> dict[str, object]:
        async with begun(Sending(), {"together": "lab.left", "site": "lab"}) as (one, _client):
            assert one.near is not None
            return one.near._about

    about = asyncio.run(scene())
    assert about["site"] == "lab"
    assert "together" not in about
