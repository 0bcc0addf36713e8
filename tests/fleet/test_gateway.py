"""What a gateway does with messages and lines, without a network and a daemon."""

import asyncio
import time
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from litegrip_fleet.far.daemon import Lines
from litegrip_fleet.far.far_session import FarSession
from litegrip_fleet.far.gateway import (
    Gateway,
    _Connection,
)
from litegrip_fleet.far.together import Together
from litegrip_fleet.far.turns import MOST_OF_A_PROGRAM, MOST_WAITING, Turns
from litegrip_fleet.wire.keys import Caller, Place
from litegrip_fleet.wire.messages import Ask, Reply, packed, unpacked

LEFT = Place("lab", "left")
CALLER = Caller("op1", "s-1", "operator")
KEY = LEFT.rpc(CALLER.user, CALLER.session, CALLER.role)
NOTHING: Any = SimpleNamespace(session=None)


class Query:
    """A query that a portal has sent, and what has become of it."""

    def __init__(self, ask: Ask, line: bytes = b"") -> None:
        self.key_expr = KEY
        self.attachment = zenoh.ZBytes(packed(ask))
        self.payload = zenoh.ZBytes(line)
        self.dropped = False
        self.replies: list[Reply] = []

    def __enter__(self) -> "Query":
        return self

    def __exit__(self, *_error: object) -> None:
        self.drop()

    def drop(self) -> None:
        self.dropped = True

    def reply(self, _key: str, _payload: bytes, *, attachment: bytes) -> None:
        self.replies.append(unpacked(Reply, attachment))


def made() -> Gateway:
    return Gateway(NOTHING, LEFT, "can0", Together(NOTHING, LEFT))


def take(gateway: Gateway, query: Any) -> None:
    gateway._asked(query, CALLER)


def opened(gateway: Gateway, about: dict[str, Any]) -> _Connection:
    """Return a session that a gateway has begun."""
    connection = _Connection(gateway._network, LEFT, CALLER, gateway._forget(KEY))
    connection.far = FarSession(
        Ask("open"),
        time.monotonic(),
        session=CALLER.session,
        voided=(),
        to_daemon=connection.to_daemon,
        push=lambda _push, _piece: None,
    )
    connection.ready, connection.about = True, about
    gateway._connections[KEY] = connection
    return connection


def test_no_session_begins_before_the_gateway_knows_what_a_stop_makes_void() -> None:
    gateway, query = made(), Query(Ask("open", ttl_s=1.0))
    take(gateway, query)
    assert (query.dropped, query.replies) == (True, [])  # the portal asks again
    assert gateway._connections == {}


def test_who_asks_again_for_a_session_hears_again_what_it_is() -> None:
    gateway, about = made(), {"user": "op1@lab"}
    opened(gateway, about)
    again, line = Query(Ask("open", ttl_s=1.0)), Query(Ask("live"))
    take(gateway, again)
    take(gateway, line)
    assert [reply.about for reply in (*again.replies, *line.replies)] == [about, None]


def test_a_line_of_a_daemon_that_has_ended_is_no_count_of_the_next_ones_stops() -> None:
    gateway = made()
    connection = opened(gateway, {})
    gateway._generation = 0  # the next daemon's, by its hello
    gateway._note_for(connection.far)(b'{"jsonrpc":"2.0","id":1,"result":{"generation":40}}\n')
    assert (gateway._generation, connection.far.generation) == (0, 40)


def test_a_flood_of_one_user_waits_for_everybody_else() -> None:
    gateway, taken = made(), list[str]()
    asked: Any = lambda _query, caller: taken.append(caller.user)  # noqa: E731
    gateway._asked = asked  # type: ignore[method-assign]

    async def flooded() -> list[Query]:
        queries = [Query(Ask("live")) for _ in range(MOST_OF_A_PROGRAM + 10)]
        loop, queue = asyncio.get_running_loop(), cast(Any, gateway._queue)
        for query in queries:
            loop.call_soon(queue, query)
        other: Any = Query(Ask("live"))
        other.key_expr = LEFT.rpc("op2", "s-1", "observer")
        loop.call_soon(queue, other)
        while len(taken) <= MOST_OF_A_PROGRAM:
            await asyncio.sleep(0)
        return queries

    queries = asyncio.run(flooded())
    assert taken.index("op2") <= 2
    assert sum(query.dropped for query in queries) == 10
    assert not gateway._turns


def test_a_flood_of_one_program_waits_for_the_same_users_others() -> None:
    turns = Turns[str]()
    while turns.add("op1", "flood", "flood"):
        pass
    assert turns.add("op1", "polite", "polite")
    assert turns.add("op2", "other", "other")
    assert sorted(turns.take() for _ in range(4)) == ["flood", "flood", "other", "polite"]


def test_a_user_has_no_more_room_with_many_programs() -> None:
    turns = Turns[int]()
    kept = [turns.add("op1", f"s-{number}", number) for number in range(MOST_WAITING + 10)]
    assert sum(kept) == MOST_WAITING
    assert turns.add("op2", "s-0", 0)
    taken = [turns.take() for _ in range(MOST_WAITING + 1)]
    assert sorted(taken) == sorted([*range(MOST_WAITING), 0])
    assert not turns


class Session:
    """A session on the network; `offers` has what is declared by it."""

    def __init__(self) -> None:
        self.offers: list[str] = []

    def declare_queryable(self, key: str, _queue: object) -> Any:
        self.offers.append(key)
        return SimpleNamespace(handler=self, undeclare=lambda: None)

    def recv(self) -> None:
        raise zenoh.ZError("closed")

    def liveliness(self) -> Any:
        return SimpleNamespace(declare_token=self.offers.append)


def test_what_is_offered_and_alive_is_so_by_the_session_of_the_time() -> None:
    first, second = Session(), Session()
    network: Any = SimpleNamespace(session=first)
    together = Together(network, LEFT)
    gateway = Gateway(network, LEFT, "can0", together)

    async def look() -> None:
        for session in (first, second):
            network.session = session
            together.look(time.monotonic())
            together.look(time.monotonic())
            gateway._is_reached = True

    asyncio.run(look())
    assert LEFT.alive not in first.offers
    assert second.offers == [*first.offers, LEFT.alive]


def test_an_answer_reaches_its_client_whatever_its_id_is() -> None:
    lines = [
        b'{"jsonrpc":"2.0","id":%b,"result":{}}\n' % identity
        for identity in (b'"gateway"', b"0", b'"0"', b'"live"', b"-1")
    ]

    async def passed_on() -> list[bytes]:
        connection, said = opened(made(), {}), list[bytes]()
        connection.far.said = said.append  # type: ignore[method-assign, assignment]
        daemon = Lines()
        daemon.connection_made(cast("Any", SimpleNamespace(close=lambda: None)))
        daemon.data_received(b"".join(lines))
        daemon.connection_lost(None)
        connection.attach(daemon)
        await connection.pass_on(lambda _line: None)
        return said

    assert asyncio.run(passed_on()) == lines


@pytest.mark.parametrize(
    ("line", "renewed"), [(b'{"id":1,"method":"lease.acquire"}\n', 1), (b'{"id":1}\n', 0)]
)
def test_a_sign_of_life_renews_a_lease_where_there_may_be_one(line: bytes, renewed: int) -> None:
    gateway, written = made(), list[bytes | None]()
    connection = opened(gateway, {})
    connection.far._to_daemon = connection.to_daemon = written.append  # type: ignore[method-assign, assignment]
    take(gateway, Query(Ask("line", 1), line))
    take(gateway, Query(Ask("live")))
    lives = [one for one in written if one is not None and b"state.get" in one]
    assert len(lives) == renewed


def test_samples_are_not_sent_while_life_is_late() -> None:
    gateway, said = made(), list[bytes]()
    connection = opened(gateway, {})
    connection.far._push = lambda _push, piece: said.append(piece)
    sample = b'{"jsonrpc":"2.0","method":"state.sample","params":{"seq":1}}\n'
    begun_s = connection.far._heard_s
    for after_s in (0.1, 0.9, 0.95):
        gateway._look(begun_s + after_s)
        connection.far.said(sample)
    assert (len(said), connection.ready) == (1, True)
    take(gateway, Query(Ask("live")))
    gateway._look(time.monotonic())
    connection.far.said(sample)
    assert len(said) == 2
    gateway._look(time.monotonic() + 1.1)
    assert not connection.ready
