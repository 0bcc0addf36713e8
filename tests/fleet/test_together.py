"""What gateway and portal say of many sessions at once: samples of the state, and signs of life."""

import asyncio
import contextlib
import json
import random
import threading
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

import litegrip_fleet.near.together as near_together
from litegrip_fleet.far.far_session import FarSession
from litegrip_fleet.far.gateway import Gateway, _Connection
from litegrip_fleet.far.together import GATHER_EACH_S, GATHER_MOST_S, Publication, newest
from litegrip_fleet.far.together import Together as FarTogether
from litegrip_fleet.near.together import MOST_PUBLICATIONS
from litegrip_fleet.near.together import Together as NearTogether
from litegrip_fleet.wire.daemon_lines import generation_in
from litegrip_fleet.wire.keys import PREFIX, Caller, Place
from litegrip_fleet.wire.messages import Ask, BadMessageError, Push, Reply, packed, unpacked
from litegrip_fleet.wire.network import MAX_MESSAGE_BYTES, Answered
from litegrip_fleet.wire.together import (
    MOST_LIVES,
    Life,
    Sample,
    lives_in,
    packed_lives,
    packed_replies,
    packed_samples,
    replies_in,
    samples_in,
)
from tests.properties import examples

LEFT, RIGHT = Place("lab", "left"), Place("lab", "right")
NOTHING: Any = SimpleNamespace()


def ended() -> None:
    """Receive from a session that has ended."""
    raise zenoh.ZError("closed")


SILENT: Any = SimpleNamespace(
    declare_subscriber=lambda *_arguments: SimpleNamespace(handler=SimpleNamespace(recv=ended))
)
"""A session of zenoh's by which nothing comes."""

names = st.from_regex(r"[A-Za-z0-9_-]{1,32}", fullmatch=True)
counts = st.integers(0, 2**53 - 1)
objects = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=40),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=12,
)


def sample_line(number: int, subscription: int = 1, rest_bytes: int = 0, **state: Any) -> bytes:
    """Return a sample as a daemon sends it."""
    params = {"subscription": subscription, "seq": number, "dropped": 0, "state": state}
    params["rest"] = "x" * rest_bytes
    message = {"jsonrpc": "2.0", "method": "state.sample", "params": params}
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


samples = st.builds(
    Sample,
    names,
    names,
    st.none() | counts,
    st.builds(sample_line, counts, st.integers(1, 8), st.integers(0, 30_000)),
)


# The messages -------------------------------------------------------------------------------------


@examples(60)
@given(st.lists(samples, max_size=60))
def test_samples_arrive_as_they_were_sent_in_messages_that_zenoh_takes(sent: list[Sample]) -> None:
    messages = list(packed_samples(sent))
    assert [one for message in messages for one in samples_in(message)] == sent
    assert all(len(message) < MAX_MESSAGE_BYTES for message in messages)
    assert len(messages) <= 1 + sum(len(one.line) + 96 for one in sent) // 25_000


def test_short_samples_of_many_fill_a_message_and_no_more() -> None:
    row = Sample("g" * 32, "s" * 32, 2**53 - 1, sample_line(1))
    messages = list(packed_samples([row] * 1000))
    assert len(messages) > 1
    assert all(len(message) < MAX_MESSAGE_BYTES for message in messages)


ROW = ["left", "s-1", None]
ODD_COUNTS: tuple[object, ...] = (-1, 2**60, True, 1.5, "1", [])


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\n",
        b"[" * 60_000,
        b"\xff\n",
        b"[]\n",
        b'{"v":1}\n',
        b'{"v":2,"to":[]}\n',
        b'{"v":1,"to":7}\n',
        b'{"v":1,"to":[]}\n' + sample_line(1),
        json.dumps({"v": 1, "to": [ROW]}).encode() + b"\n",
        json.dumps({"v": 1, "to": [ROW]}).encode() + b"\n" + sample_line(1).strip(),
        json.dumps({"v": 1, "to": [ROW]}).encode() + b'\n{"jsonrpc":"2.0","id":1,"result":{}}\n',
        *(
            json.dumps({"v": 1, "to": [row]}).encode() + b"\n" + sample_line(1)
            for row in (7, [], ["left"], ["left", "s"], [1, "s", 1], ["left", None, 1])
        ),
        *(
            json.dumps({"v": 1, "to": [["left", "s", odd]]}).encode() + b"\n" + sample_line(1)
            for odd in ODD_COUNTS
        ),
        json.dumps({"v": 1, "to": [["x" * 33, "s", 1]]}).encode() + b"\n" + sample_line(1),
    ],
)
def test_what_is_no_publication_of_samples_is_refused(payload: bytes) -> None:
    with pytest.raises(BadMessageError):
        samples_in(payload)


@examples(200)
@given(objects, objects)
def test_no_object_that_comes_as_lives_or_replies_is_a_defect(rows: object, now_s: object) -> None:
    payload = json.dumps({"v": 1, "lives": [rows, rows], "now_s": now_s}).encode()
    with contextlib.suppress(BadMessageError):
        lives_in(payload)
    with contextlib.suppress(BadMessageError):
        replies_in(payload)


@examples(100)
@given(st.lists(st.builds(Life, names, names, counts, st.none() | st.floats(0, 2**40)), max_size=9))
def test_signs_of_life_and_their_replies_arrive_as_they_were_sent(lives: list[Life]) -> None:
    assert lives_in(packed_lives(lives)) == lives
    gone = {"code": -32060, "message": "gone", "data": {}}
    replies = [
        (life, Reply(index, life.got, 7.5, index or None, gone if index % 2 else None))
        for index, life in enumerate(lives)
    ]
    expected = {(life.gripper, life.session): reply for life, reply in replies}
    assert replies_in(packed_replies(7.5, replies)) == expected


def test_no_message_has_the_lives_of_more_sessions_than_its_answer_has_room_for() -> None:
    lives = [Life("g" * 32, f"{index:032}", 2**52, 1e9) for index in range(3 * MOST_LIVES)]
    assert len(packed_lives(lives[:MOST_LIVES])) < MAX_MESSAGE_BYTES
    assert len(lives_in(packed_lives(lives))) == MOST_LIVES
    gone = {"code": -32060, "message": "x" * 100, "data": {"reason": "unreachable"}}
    replies = [(life, Reply(2**52, 2**52, 1e9, 2**52, gone)) for life in lives[:MOST_LIVES]]
    assert len(packed_replies(1e9, replies)) < MAX_MESSAGE_BYTES


@pytest.mark.parametrize(
    ("state", "count"),
    [
        ({"stop_generation": 7}, 7),
        ({"stop": {"generation": 6}, "stop_generation": 7}, 7),
        ({"stop": {"generation": 6}}, 6),
        ({"stop": None}, None),
        ({"stop_generation": 12, "newer": "x"}, 12),
    ],
)
def test_a_sample_says_how_many_stops_there_were(state: dict[str, Any], count: int | None) -> None:
    assert generation_in(sample_line(1, **state)) == count


# The gateway --------------------------------------------------------------------------------------


def test_the_newest_of_each_subscription_replaces_those_before_it() -> None:
    waiting = [
        (key, Sample(gripper, session, None, sample_line(number, subscription)))
        for number in range(5)
        for key, gripper, session in (("a", "left", "s-1"), ("a", "right", "s-1"))
        for subscription in (1, 2)
    ]
    kept = newest(waiting)
    assert len(kept) == 4
    numbers = [json.loads(one.line)["params"]["seq"] for _key, one in kept]
    assert numbers == [4, 4, 4, 4]


class Line:
    """A network that takes what is published only while it is `open`."""

    def __init__(self) -> None:
        self.open = threading.Event()
        self.open.set()
        self.taken: list[tuple[str, list[Sample]]] = []
        self.messages = 0

    def send(self, key: str, payload: bytes) -> None:
        self.messages += 1
        self.open.wait(30.0)
        self.taken.append((key, samples_in(payload)))

    @property
    def numbers(self) -> list[int]:
        """The samples that have arrived, by their numbers."""
        lines = [one.line for _key, some in self.taken for one in some]
        return [json.loads(line)["params"]["seq"] for line in lines]


async def until(true: Any) -> None:
    async def waiting() -> None:
        while not true():
            await asyncio.sleep(0)

    await asyncio.wait_for(waiting(), 30.0)


def test_while_the_network_takes_samples_none_is_left_out() -> None:
    line = Line()

    async def scene() -> None:
        publication = Publication(line.send)
        for number in range(500):
            for name in ("s-1", "s-2"):
                publication.add("key", Sample("left", name, None, sample_line(number)))
            if number % 10 == 0:
                await asyncio.sleep(0)
                await until(lambda: not publication._is_sending)
        await until(lambda: len(line.numbers) == 1000)

    asyncio.run(scene())
    assert line.numbers == [number for number in range(500) for _ in range(2)]
    assert line.messages < 100


def test_a_sample_that_comes_alone_waits_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line()

    async def scene() -> float:
        publication, loop = Publication(line.send), asyncio.get_running_loop()
        due: list[float] = []
        call_at = loop.call_at

        def noted(at_s: float, *rest: Any, **more: Any) -> asyncio.TimerHandle:
            due.append(at_s - loop.time())
            return call_at(at_s, *rest, **more)

        monkeypatch.setattr(loop, "call_at", noted)
        publication.add("key", Sample("left", "s-1", None, sample_line(1)))
        await until(lambda: line.taken)
        publication.add("key", Sample("left", "s-1", None, sample_line(2)))
        return due[0]

    assert asyncio.run(scene()) <= 0.0


def test_while_the_network_takes_none_only_the_newest_waits_and_nobody_is_held_up() -> None:
    line = Line()
    line.open.clear()

    async def scene() -> None:
        publication = Publication(line.send)
        publication.add("key", Sample("left", "s-1", None, sample_line(0)))
        await until(lambda: line.messages == 1)
        for number in range(1, 200):
            publication.add("key", Sample("left", "s-1", 3, sample_line(number)))
            publication.add("key", Sample("left", "s-1", 3, sample_line(number, 2)))
        await until(lambda: len(publication._waiting) == 2)  # the loop goes on meanwhile
        line.open.set()
        await until(lambda: len(line.taken) == 2)

    asyncio.run(scene())
    assert line.numbers == [0, 199, 199]


def test_samples_of_two_portals_go_to_two_keys() -> None:
    line = Line()

    async def scene() -> None:
        publication = Publication(line.send)
        for key in ("a", "b"):
            publication.add(key, Sample("left", f"s-{key}", None, sample_line(1)))
        await until(lambda: len(line.taken) == 2)

    asyncio.run(scene())
    assert {key: [one.session for one in some] for key, some in line.taken} == {
        "a": ["s-a"],
        "b": ["s-b"],
    }


class Network:
    """What a gateway puts."""

    def __init__(self) -> None:
        self.put_at: list[str] = []

    def put(self, key: Any, _payload: bytes, **_options: Any) -> None:
        self.put_at.append(str(key))


def test_samples_go_on_by_another_session_after_one_was_closed_under_them() -> None:
    class Closed(Network):
        def put(self, key: Any, _payload: bytes, **_options: Any) -> None:
            super().put(key, _payload)
            raise zenoh.ZError("session closed")

    async def scene(former: Network, later: Network) -> None:
        membership = SimpleNamespace(session=former)
        publication = FarTogether(cast("Any", membership), LEFT).publication
        publication.add("key", Sample("left", "s-1", None, sample_line(1)))
        await until(lambda: former.put_at)
        membership.session = later
        publication.add("key", Sample("left", "s-1", None, sample_line(2)))
        await until(lambda: later.put_at)

    asyncio.run(scene(Closed(), Network()))


class Query:
    """Signs of life of a user, and what they are answered."""

    def __init__(self, caller: Caller, lives: list[Life] | bytes) -> None:
        self.key_expr = LEFT.rpc(caller.user, caller.session, caller.role)
        self.attachment = zenoh.ZBytes(packed(Ask("lives")))
        self.payload = zenoh.ZBytes(lives if isinstance(lives, bytes) else packed_lives(lives))
        self.answer: bytes | None = None
        self.dropped = False

    def __enter__(self) -> "Query":
        return self

    def __exit__(self, *_error: object) -> None:
        return

    def drop(self) -> None:
        self.dropped = True

    def reply(self, _key: str, payload: bytes) -> None:
        self.answer = payload


class Robot:
    """The gateways of a machine of two grippers, with a session of each of two users at both."""

    def __init__(self) -> None:
        self.network = Network()
        self.membership = cast("Any", SimpleNamespace(session=self.network))
        self.together = FarTogether(self.membership, LEFT)
        self.gateways = {
            place: Gateway(self.membership, place, "can0", self.together) for place in (LEFT, RIGHT)
        }
        for gateway in self.gateways.values():
            gateway._offered_by = cast("Any", self.network)
        self.heard: dict[tuple[str, str], list[Ask]] = {}
        self.sessions = {
            (user, place.gripper): self._session(user, place)
            for user in ("op1", "op2")
            for place in (LEFT, RIGHT)
        }

    def _session(self, user: str, place: Place) -> _Connection:
        caller = Caller(user, f"{user}-1", "operator")
        gateway, key = self.gateways[place], place.rpc(user, caller.session, caller.role)
        connection = _Connection(self.membership, place, caller, gateway._forget(key))
        connection.far = FarSession(
            Ask("open"),
            0.0,
            session=caller.session,
            voided=(),
            to_daemon=connection.to_daemon,
            push=connection.push,
        )
        heard = self.heard.setdefault((user, place.gripper), [])

        def asked(ask: Ask, line: bytes, now_s: float) -> None:
            assert (line, now_s > 0.0) == (b"", True)
            heard.append(ask)

        connection.far.asked = asked  # type: ignore[method-assign]
        connection.ready = True
        gateway._connections[key] = connection
        return connection

    def ask(self, query: Query, session: str = "portal-all") -> dict[tuple[str, str], Reply]:
        caller = Caller(query.key_expr.split("/")[5], session, "operator")
        self.gateways[LEFT]._asked(cast("Any", query), caller)
        return {} if query.answer is None else replies_in(query.answer)


def test_one_message_shows_the_life_of_a_users_sessions_at_all_grippers() -> None:
    robot, caller = Robot(), Caller("op1", "portal-all", "operator")
    lives = [Life("left", "op1-1", 3, 5.0), Life("right", "op1-1", 4, None)]
    replies = robot.ask(Query(caller, lives))
    assert {key: reply.gone for key, reply in replies.items()} == {
        ("left", "op1-1"): None,
        ("right", "op1-1"): None,
    }
    assert robot.heard["op1", "left"] == [Ask("live", got=3, at_s=5.0)]
    assert robot.heard["op1", "right"] == [Ask("live", got=4)]


def test_nobody_shows_the_life_of_anothers_session_nor_of_one_with_another_role() -> None:
    robot = Robot()
    lives = [Life("left", "op1-1", 0, None), Life("nowhere", "op1-1", 0, None)]
    replies = robot.ask(Query(Caller("op2", "portal-all", "operator"), lives))
    assert list(replies) == [("left", "op1-1")]
    gone = replies["left", "op1-1"].gone
    assert gone is not None
    assert "the session has ended" in gone["message"]
    query = Query(Caller("op1", "portal-all", "observer"), lives)
    robot.gateways[LEFT]._asked(cast("Any", query), Caller("op1", "portal-all", "observer"))
    assert robot.heard == {key: [] for key in robot.heard}


def test_a_session_that_is_being_opened_is_left_out_of_the_answer() -> None:
    robot = Robot()
    robot.sessions["op1", "left"].ready = False
    lives = [Life("left", "op1-1", 0, None), Life("right", "op1-1", 0, None)]
    replies = robot.ask(Query(Caller("op1", "portal-all", "operator"), lives))
    assert list(replies) == [("right", "op1-1")]


@pytest.mark.parametrize("payload", [b"", b"[]", b'{"v":1,"lives":[["left"]]}'])
def test_lives_that_are_none_are_dropped(payload: bytes) -> None:
    query = Query(Caller("op1", "portal-all", "operator"), payload)
    assert Robot().ask(query) == {}
    assert query.dropped


BATCH = b'{"jsonrpc":"2.0","method":"state.batch","params":{"subscription":1,"seq":1}}\n'
ANSWER = b'{"jsonrpc":"2.0","id":1,"result":{}}\n'


def test_samples_are_published_and_all_else_stays_in_the_tunnel() -> None:
    robot, caller = Robot(), Caller("op1", "op1-1", "operator")
    connection = robot.sessions["op1", "right"]

    async def scene() -> None:
        key = robot.together.key(caller, "portal-all")
        connection.publish(robot.together.publication, key)
        for line in (sample_line(1), BATCH, ANSWER):
            connection.far.said(line)
        await until(lambda: len(robot.network.put_at) == 3)

    asyncio.run(scene())
    assert robot.network.put_at == [
        RIGHT.to("op1", "op1-1"),
        RIGHT.to("op1", "op1-1"),
        LEFT.to("op1", "portal-all"),
    ]


def test_an_older_portal_gets_its_samples_in_the_tunnel() -> None:
    robot = Robot()
    robot.sessions["op1", "right"].far.said(sample_line(1))
    assert robot.network.put_at == [RIGHT.to("op1", "op1-1")]


def test_samples_of_many_sessions_wait_for_one_another_and_those_of_few_do_not() -> None:
    robot, caller = Robot(), Caller("op1", "op1-1", "operator")
    publication = robot.together.publication
    for connection in robot.sessions.values():
        connection.publish(publication, robot.together.key(caller, "portal-all"))
    assert publication._gather_s == pytest.approx(4 * GATHER_EACH_S)
    publication.sessions += 1000
    assert publication._gather_s == GATHER_MOST_S
    publication.sessions -= 1000
    for connection in robot.sessions.values():
        connection.close()
        connection.close()
    assert publication._gather_s == 0.0


def test_a_gateway_that_was_held_up_itself_takes_signs_of_life_before_it_ends_a_session() -> None:
    robot = Robot()
    for gateway in robot.gateways.values():
        gateway._connections.clear()
    looked: list[float] = []
    robot.together.looks.append(looked.append)
    begun_s = robot.together._looked_s
    for after_s in (0.05, 0.1, 1.3, 1.35, 1.4, 2.0, 2.6, 3.2):
        robot.together.look(begun_s + after_s)
    expected = (0.05, 0.1, 1.35, 1.4, 2.6)  # held up each time, it looks every other time
    assert looked == [begun_s + after_s for after_s in expected]


# The portal ---------------------------------------------------------------------------------------


class Client:
    """A client of a portal, and how its life was shown."""

    def __init__(self, place: Place, session: str) -> None:
        self.place = place
        self.session = session
        self.alone_s = 0.0
        self.alone: list[Ask] = []
        self.replies: list[Reply | None] = []

    def replied(self, reply: Reply | None, _sent_s: float) -> None:
        self.replies.append(reply)

    def show_alone(self, message: Ask) -> None:
        self.alone.append(message)
        self.alone_s = float(Client.count())

    _count = 0

    @classmethod
    def count(cls) -> int:
        cls._count += 1
        return cls._count


class Portals:
    """The portals of a process with one client for each gripper, and the gateway's answers."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
        self.together = NearTogether(lambda: SILENT, "op1", "operator")
        self.clients = [Client(Place("lab", f"{index:04}"), f"s-{index}") for index in range(count)]
        self.asked: list[tuple[str, list[Life]]] = []
        self.answers: list[bytes] | None = None
        monkeypatch.setattr(near_together, "ask", self._ask)
        self.together.ticks.append(self._tick)

    def _ask(
        self,
        _session: object,
        key: str,
        payload: bytes,
        attached: bytes,
        loop: asyncio.AbstractEventLoop,
        *,
        within_s: float,
    ) -> "asyncio.Future[list[Answered]]":
        assert unpacked(Ask, attached) == Ask("lives")
        assert within_s <= 1.0
        lives = lives_in(payload)
        self.asked.append((key, lives))
        future: asyncio.Future[list[Answered]] = loop.create_future()
        answer = packed_replies(9.0, [(life, Reply(1, 2, 9.0)) for life in lives])
        payloads = [answer] if self.answers is None else self.answers
        future.set_result([Answered(key, one, None, 0.0) for one in payloads])
        return future

    def _tick(self, now_s: float, _states: dict[int, str | None]) -> None:
        assert self.together.is_ticking
        for client in self.clients:
            self.together.shows(client, LEFT, Ask("live", got=7, at_s=now_s))

    async def tick(self, times: int = 1) -> None:
        for index in range(times):
            self.together.tick(float(index))
            await asyncio.sleep(0)
            await asyncio.sleep(0)


def test_the_lives_of_many_go_in_one_message_and_one_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    portals = Portals(monkeypatch, 5)
    asyncio.run(portals.tick())
    ((key, lives),) = portals.asked
    assert key == LEFT.rpc("op1", portals.together.name, "operator")
    assert [(life.gripper, life.session, life.got) for life in lives] == [
        (client.place.gripper, client.session, 7) for client in portals.clients[1:]
    ]
    assert [len(client.alone) for client in portals.clients] == [1, 0, 0, 0, 0]
    assert [client.replies for client in portals.clients[1:]] == [[Reply(1, 2, 9.0)]] * 4


def test_each_has_its_turn_to_go_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    portals = Portals(monkeypatch, 5)
    asyncio.run(portals.tick(10))
    assert [len(client.alone) for client in portals.clients] == [2] * 5


def test_the_life_of_one_client_goes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    portals = Portals(monkeypatch, 1)
    asyncio.run(portals.tick(3))
    assert (portals.asked, len(portals.clients[0].alone)) == ([], 3)


def test_no_message_has_more_lives_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    portals = Portals(monkeypatch, 2 * MOST_LIVES + 11)
    asyncio.run(portals.tick())
    assert [len(lives) for _key, lives in portals.asked] == [MOST_LIVES, MOST_LIVES, 10]


def test_where_two_gateways_answer_each_session_asks_for_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    portals = Portals(monkeypatch, 4)
    portals.answers = [packed_replies(9.0, []), packed_replies(9.0, [])]
    asyncio.run(portals.tick())
    assert [len(client.alone) for client in portals.clients] == [1, 1, 1, 1]
    assert [client.replies for client in portals.clients] == [[], [], [], []]


@pytest.mark.parametrize("answers", [[], [b"nonsense"], [packed_replies(9.0, [])]])
def test_who_is_not_answered_is_told_nothing(
    monkeypatch: pytest.MonkeyPatch, answers: list[bytes]
) -> None:
    portals = Portals(monkeypatch, 3)
    portals.answers = answers
    asyncio.run(portals.tick())
    replies = [reply for client in portals.clients for reply in client.replies]
    assert replies == [None] * len(replies)


class Published:
    """A session of zenoh's that has publications for a portal."""

    def __init__(self, payloads: list[bytes]) -> None:
        self.key = ""
        self.handler = self
        self._payloads = payloads
        self.has_ended = threading.Event()

    def declare_subscriber(self, key: str, _channel: object) -> "Published":
        self.key = key
        return self

    def recv(self) -> Any:
        if not self._payloads:
            self.has_ended.set()
            raise zenoh.ZError("undeclared")
        key = self.key.replace("*/*", "lab/left").replace("$*", "all")
        return SimpleNamespace(key_expr=key, payload=zenoh.ZBytes(self._payloads.pop(0)))


def taken(payloads: list[bytes]) -> list[tuple[Sample, Place]]:
    """Return what a portal of the grippers left and right takes of publications by left."""
    found: list[tuple[Sample, Place]] = []

    async def scene() -> None:
        session: Any = Published(list(payloads))
        together = NearTogether(lambda: session, "op1", "operator")
        for place in (LEFT, RIGHT):
            together.takers[place] = lambda sample, carrier: found.append((sample, carrier))
        together.tick(0.0)
        assert session.key == f"{PREFIX}/*/*/to/op1/{together.name.replace('all', '$*')}"
        await asyncio.to_thread(session.has_ended.wait, 30.0)
        for _ in range(MOST_PUBLICATIONS + 1):
            await asyncio.sleep(0)

    asyncio.run(scene())
    return found


def test_samples_of_all_grippers_come_by_the_key_of_one() -> None:
    rows = [Sample(name, "s-1", 4, sample_line(1)) for name in ("left", "right", "unknown")]
    assert taken(list(packed_samples(rows))) == [(rows[0], LEFT), (rows[1], LEFT)]


def test_nonsense_is_left_out_and_the_next_publication_is_taken() -> None:
    row = Sample("left", "s-1", None, sample_line(1))
    assert taken([b"nonsense", *packed_samples([row])]) == [(row, LEFT)]


def test_of_more_publications_than_can_be_taken_the_newest_are() -> None:
    count = 10 * MOST_PUBLICATIONS
    rows = [Sample("left", "s-1", None, sample_line(number)) for number in range(count)]
    found = taken([next(packed_samples([row])) for row in rows])
    assert found[-1] == (rows[-1], LEFT)
    numbers = [rows.index(sample) for sample, _carrier in found]
    assert numbers == sorted(set(numbers))


# Late life ----------------------------------------------------------------------------------------


def test_late_life_sheds_samples_first_and_ends_a_session_only_past_its_time_to_live() -> None:
    said: list[Push] = []
    far = FarSession(
        Ask("open", ttl_s=1.0),
        0.0,
        session="s-1",
        voided=(),
        to_daemon=lambda _line: None,
        push=lambda push, _piece: said.append(push),
    )
    assert (far.is_late(0.7), far.is_late(0.8), far.is_lost(0.99)) == (False, True, False)
    far.sheds = True
    far.said(sample_line(1))
    far.said(ANSWER)
    assert [push.number for push in said] == [1]
    far.sheds = False
    far.said(sample_line(2))
    assert [push.number for push in said] == [1, None]
    assert far.is_lost(1.01)


def test_random_bytes_are_no_messages() -> None:
    chance = random.Random(1)
    for _ in range(2000):
        payload = chance.randbytes(chance.randrange(60))
        for read in (samples_in, lives_in, replies_in):
            with pytest.raises(BadMessageError):
                read(payload)
