"""A session's two halves over a network that loses, delays, repeats and reorders; virtual time."""

import json
import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_fleet.far.far_session import (
    AGAIN_BYTES,
    MOST_UNCONFIRMED_BYTES,
    PIECE_BYTES,
    ROOM_BYTES,
    FarSession,
)
from litegrip_fleet.near.near_session import AGAIN_AFTER_S, BEHIND_S, NearSession
from litegrip_fleet.wire.daemon_lines import MAX_ANSWER_BYTES, MAX_LINE_BYTES
from litegrip_fleet.wire.lateness import MOTION_COUNTS_S, RemoteClock
from litegrip_fleet.wire.messages import Ask, Push, Reply, packed, unpacked
from tests.properties import examples

TICK_S = 0.05
TTL_S = 1.0
FAR_CLOCK_AHEAD_S = 5000.0
VOIDED = frozenset({"motion.open", "motion.close", "stream.set"})


@dataclass
class Weather:
    """What the network does to a message: `loss` and `twice` are probabilities."""

    loss: float = 0.0
    twice: float = 0.0
    delay_s: float = 0.001
    jitter_s: float = 0.0
    cut: bool = False


@dataclass
class Scene:
    """A client at a portal, a daemon at a gateway, and the weather between them."""

    weather: Weather = field(default_factory=Weather)
    ttl_s: float = TTL_S
    seed: int = 1

    def __post_init__(self) -> None:
        self.now_s = 100.0
        self.to_daemon: list[bytes | None] = []
        self.daemon_times_s: list[float] = []
        self.to_client: list[bytes] = []
        self.client_lives = True
        self.portal_runs = True
        self.far_ahead_s = FAR_CLOCK_AHEAD_S
        self.closed_s: float | None = None
        self._random = random.Random(self.seed)
        self._in_flight: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0
        self.carried = 0
        clock = RemoteClock()
        clock.note(self.now_s, self.now_s, self.now_s + FAR_CLOCK_AHEAD_S)
        self.near = NearSession(
            self.ttl_s,
            clock,
            self.now_s,
            channel="lab.left",
            stop_socket="/run/lab.left.stop.sock",
            ask=self._ask,
            to_client=self.to_client.append,
        )
        self.far = FarSession(
            Ask("open", ttl_s=self.ttl_s),
            self.far_now_s,
            session="s1",
            voided=VOIDED,
            to_daemon=self._arrived,
            push=self._push,
        )

    @property
    def is_closed(self) -> bool:
        """True once the gateway has given the session up."""
        return self.closed_s is not None

    @property
    def far_now_s(self) -> float:
        return self.now_s + self.far_ahead_s

    def _arrived(self, line: bytes | None) -> None:
        self.to_daemon.append(line)
        self.daemon_times_s.append(self.now_s)

    def _carry(self, deliver: Callable[[], None]) -> None:
        self.carried += 1
        weather = self.weather
        if weather.cut or self._random.random() < weather.loss:
            return
        for _ in range(2 if self._random.random() < weather.twice else 1):
            at_s = self.now_s + weather.delay_s + self._random.random() * weather.jitter_s
            self._count += 1
            self._in_flight.append((at_s, self._count, deliver))

    def _ask(self, ask: Ask, line: bytes) -> None:
        sent_s, attached = self.now_s, packed(ask)
        self._carry(lambda: self._asked(unpacked(Ask, attached), line, sent_s))

    def _asked(self, ask: Ask, line: bytes, sent_s: float) -> None:
        if self.is_closed:
            reply = Reply(0, 0, self.far_now_s, gone={"code": 1, "message": "gone", "data": {}})
        else:
            self.far.asked(ask, line, self.far_now_s)
            reply = self.far.reply(self.far_now_s)
        attached = packed(reply)
        self._carry(lambda: self.near.replied(unpacked(Reply, attached), sent_s, self.now_s))

    def _push(self, push: Push, piece: bytes) -> None:
        attached = packed(push)
        self._carry(lambda: self.near.pushed(unpacked(Push, attached), piece, self.now_s))

    def run(self, seconds: float) -> None:
        """Let time pass, in steps of a tick and of what arrives in between."""
        ends_s = self.now_s + seconds
        while self.now_s < ends_s - 1e-9:
            next_s = min(self.now_s + TICK_S, ends_s)
            while due := [entry for entry in self._in_flight if entry[0] <= next_s]:
                entry = min(due)
                self._in_flight.remove(entry)
                self.now_s = max(self.now_s, entry[0])
                entry[2]()
            self.now_s = next_s
            if self.portal_runs:
                self.near.tick(self.now_s, lives=self.client_lives)
            if not self.is_closed and self.far.is_lost(self.far_now_s):
                self.closed_s = self.now_s

    def say(self, method: str, identity: int | None = 1, **params: Any) -> None:
        """Let the client send a request."""
        request: dict[str, Any] = {"jsonrpc": "2.0", "method": method, "params": params}
        if identity is not None:
            request["id"] = identity
        self.write(json.dumps(request).encode() + b"\n")

    def write(self, line: bytes) -> None:
        """Let the client send a line that need not be a request."""
        self.near.asked(line, self.now_s, self.now_s)

    def daemon_says(self, **message: Any) -> bytes:
        """Let the daemon send a line."""
        line = json.dumps({"jsonrpc": "2.0", **message}, separators=(",", ":")).encode() + b"\n"
        self.far.said(line)
        return line

    def daemon_says_in_vain(self, **message: Any) -> bytes:
        """Let the daemon send a line that the network loses."""
        self.weather.cut = True
        line = self.daemon_says(**message)
        self.weather.cut = False
        return line

    def look(self, seen: Callable[[Ask, float], Ask | None]) -> None:
        """Let each of the portal's messages pass as `seen` returns it; it gets the time, too."""
        take = self.far.asked

        def asked(ask: Ask, line: bytes, now_s: float) -> None:
            passed = seen(ask, now_s)
            if passed is not None:
                take(passed, line, now_s)

        self.far.asked = asked  # type: ignore[method-assign]

    @property
    def asked(self) -> list[dict[str, Any]]:
        """What the daemon has got."""
        return [json.loads(line) for line in self.to_daemon if line is not None]

    @property
    def reasons(self) -> list[str]:
        """Why the client was refused."""
        return [one["error"]["data"]["reason"] for one in self.told if "error" in one]

    @property
    def told(self) -> list[dict[str, Any]]:
        """What the client has got."""
        return [json.loads(line) for line in self.to_client]


@examples(60)
@given(
    loss=st.floats(0.0, 0.4),
    twice=st.floats(0.0, 0.4),
    jitter_s=st.floats(0.0, 0.2),
    seed=st.integers(0, 2**32),
    spacing_s=st.sampled_from([0.0, 0.005, 0.05]),
)
def test_each_line_arrives_once_and_in_order_both_ways(
    loss: float, twice: float, jitter_s: float, seed: int, spacing_s: float
) -> None:
    scene = Scene(Weather(loss, twice, 0.01, jitter_s), ttl_s=5.0, seed=seed)
    said = []
    for number in range(1, 31):
        scene.say("state.get", number)
        said.append(scene.daemon_says(id=number, result={"n": number}))
        scene.run(spacing_s)
    scene.weather = Weather(delay_s=0.01)
    scene.run(2.0)
    assert [request["id"] for request in scene.asked] == list(range(1, 31))
    assert scene.to_client == said


def test_without_trouble_a_line_and_its_answer_take_one_round_trip() -> None:
    scene = Scene(Weather(delay_s=0.02))
    scene.say("state.get", 7)
    scene.run(0.02)
    assert [request["id"] for request in scene.asked] == [7]
    scene.daemon_says(id=7, result={})
    scene.run(0.02)
    assert [answer["id"] for answer in scene.told] == [7]


@examples(60)
@given(cut_s=st.floats(0.0, 3.0), seed=st.integers(0, 2**32), jitter_s=st.floats(0.0, 1.0))
def test_what_a_mended_network_gives_back_moves_nothing(
    cut_s: float, seed: int, jitter_s: float
) -> None:
    scene = Scene(Weather(jitter_s=jitter_s), ttl_s=5.0, seed=seed)
    sent_s = {}
    for number in range(1, 21):
        sent_s[number] = scene.now_s
        scene.say("motion.open", number)
        if number == 10:
            scene.weather.cut = True
            scene.run(cut_s)
            scene.weather.cut = False
        scene.run(0.02)
    scene.weather.jitter_s = 0.0
    scene.run(2.0)
    moved = dict(zip([line["id"] for line in scene.asked], scene.daemon_times_s, strict=True))
    for number, arrived_s in moved.items():
        # The clock is reckoned to half of a round trip.
        assert arrived_s - sent_s[number] <= MOTION_COUNTS_S + jitter_s + 0.001
    refused = [answer["id"] for answer in scene.told if "error" in answer]
    assert sorted([*moved, *refused]) == list(range(1, 21))
    assert set(scene.reasons) <= {"too_late"}


@pytest.mark.parametrize("cut_s", [1.2, 3.0, 10.0])
def test_a_cut_that_is_longer_than_the_time_to_live_ends_both_ends(cut_s: float) -> None:
    scene = Scene()
    scene.run(2.0)
    begun_s = scene.now_s
    scene.weather.cut = True
    scene.say("motion.open", 5)
    scene.run(cut_s)
    assert scene.near.ended
    assert scene.closed_s is not None
    assert scene.closed_s - begun_s <= TTL_S + 2 * TICK_S
    assert (scene.told[-1]["id"], scene.reasons) == (None, ["unreachable"])
    scene.weather.cut = False
    before = scene.carried
    scene.run(2.0)
    assert scene.asked == []
    assert scene.carried == before  # it has ended: no life is shown


def test_a_cut_that_is_shorter_ends_nothing() -> None:
    scene = Scene()
    scene.run(1.0)
    scene.weather.cut = True
    scene.say("state.get", 5)
    line = scene.daemon_says(method="event", params={})
    scene.run(0.6)
    scene.weather.cut = False
    scene.run(0.5)
    assert [request["id"] for request in scene.asked] == [5]
    assert scene.to_client == [line]
    assert not scene.near.ended


def test_a_session_without_traffic_lives_through_bad_weather() -> None:
    scene = Scene(Weather(0.2, 0.0, 0.02, 0.05))
    scene.run(60.0)
    assert scene.closed_s is None
    assert not scene.near.ended


def test_a_quiet_session_shows_life_four_times_in_its_time_to_live() -> None:
    scene = Scene(Weather(delay_s=0.005))
    scene.say("state.get", 1)  # once taken, it is not sent again
    scene.run(1.0)
    before = scene.carried
    scene.run(10.0)
    assert (scene.carried - before) / 10.0 == pytest.approx(2 * 4 / TTL_S, rel=0.2)


def test_a_frozen_client_loses_its_session_and_is_told_when_it_goes_on() -> None:
    scene = Scene()
    scene.run(1.0)
    scene.client_lives = False
    begun_s = scene.now_s
    scene.run(3.0)
    assert scene.closed_s is not None
    assert scene.closed_s - begun_s <= TTL_S + 2 * TICK_S
    assert not scene.near.ended  # nobody there to be told
    scene.client_lives = True
    scene.weather.twice = 1.0
    scene.run(1.0)
    assert [told["error"]["message"] for told in scene.told] == ["gone"]


def test_a_frozen_client_shows_no_life_by_what_comes_for_it() -> None:
    scene = Scene()
    scene.run(1.0)
    scene.client_lives = False
    for number in range(60):
        if scene.is_closed:
            break
        scene.daemon_says(id=number, result={"text": "x" * 2 * PIECE_BYTES})
        scene.run(TICK_S)
    assert scene.is_closed


def test_a_sign_of_life_says_when_it_was_sent_by_the_gateways_clock() -> None:
    scene, sent_s = Scene(Weather(delay_s=0.2)), []

    def seen(ask: Ask, now_s: float) -> Ask:
        sent_s.append((ask.op, ask.at_s, now_s))
        return ask

    scene.look(seen)
    scene.run(3.0)
    assert len(sent_s) > 5
    for op, at_s, now_s in sent_s:
        assert op == "live"
        assert at_s == pytest.approx(now_s - 0.2, abs=0.01)


def test_a_sign_of_life_that_comes_late_counts_from_when_it_was_shown() -> None:
    scene = Scene(ttl_s=2.0)
    scene.run(1.0)
    scene.weather = Weather(delay_s=0.9)
    scene.run(1.0)
    scene.client_lives = False
    begun_s = scene.now_s
    scene.run(4.0)
    assert scene.closed_s is not None
    assert scene.closed_s - begun_s <= 2.0 + 2 * TICK_S


def test_no_sign_of_life_counts_from_the_future() -> None:
    scene = Scene()
    scene.far.asked(Ask("live", at_s=scene.far_now_s + 3600.0), b"", scene.far_now_s)
    scene.portal_runs = False
    scene.run(TTL_S + 2 * TICK_S)
    assert scene.is_closed


def test_a_frozen_portal_loses_its_sessions() -> None:
    scene = Scene()
    scene.portal_runs = False
    scene.run(1.5)
    assert scene.is_closed


def test_what_is_read_late_by_a_portal_that_was_held_up_is_late() -> None:
    scene = Scene()
    line = b'{"jsonrpc":"2.0","id":9,"method":"motion.open"}\n'
    scene.near.asked(line, scene.now_s - 0.7, scene.now_s)
    scene.run(0.1)
    assert scene.asked == []
    assert scene.reasons == ["too_late"]


def test_a_long_line_travels_in_pieces_and_arrives_whole() -> None:
    scene = Scene(Weather(0.2, 0.2, 0.01, 0.1), ttl_s=5.0)
    long = scene.daemon_says(id=1, result={"text": "x" * (3 * PIECE_BYTES)})
    after = scene.daemon_says(id=2, result={})
    scene.weather = Weather()
    scene.run(2.0)
    assert scene.to_client == [long, after]


@pytest.mark.parametrize("pieces", [1, 2])
def test_a_line_that_fills_its_pieces_arrives_without_the_next_one(pieces: int) -> None:
    scene = Scene()
    frame = len(scene.daemon_says(id=1, result={"text": ""}))
    whole = scene.daemon_says(id=2, result={"text": "x" * (pieces * PIECE_BYTES - frame)})
    scene.run(0.1)
    assert len(whole) == pieces * PIECE_BYTES
    assert scene.to_client[1:] == [whole]


def test_a_line_that_is_refused_holds_up_none_behind_it() -> None:
    scene = Scene()
    for letters in (MAX_LINE_BYTES - 2, MAX_LINE_BYTES):  # between quotes: the first fits
        scene.write(b'"' + b"x" * letters + b'"\n')
    scene.say("state.get", 3)
    scene.run(1.0)
    assert [len(line) for line in scene.to_daemon[:1] if line] == [MAX_LINE_BYTES + 1]
    assert json.loads(scene.to_daemon[-1] or b"")["id"] == 3
    assert scene.reasons == ["line_too_long"]


def test_a_sample_is_not_sent_twice_and_never_inside_of_a_line() -> None:
    scene = Scene()
    scene.daemon_says_in_vain(method="state.sample", params={"seq": 1})
    scene.daemon_says(method="state.sample", params={"seq": 2})
    long = scene.daemon_says(id=1, result={"text": "x" * (2 * PIECE_BYTES)})
    scene.daemon_says(method="state.sample", params={"seq": 3})
    scene.run(2.0)
    samples = [told["params"]["seq"] for told in scene.told if "params" in told]
    assert samples[:1] == [2]
    assert 1 not in samples
    assert long in scene.to_client


def test_the_daemon_is_not_read_while_the_portal_is_behind() -> None:
    scene = Scene()
    scene.weather.cut = True
    for number in range(2 * ROOM_BYTES // 10_000):
        scene.daemon_says(id=number, result={"text": "x" * 10_000})
    rooms = [scene.far.has_room]
    scene.weather.cut = False
    scene.run(2.0)
    assert [*rooms, scene.far.has_room] == [False, True]
    assert [told["id"] for told in scene.told] == list(range(2 * ROOM_BYTES // 10_000))


def test_much_that_arrives_is_confirmed_before_the_next_sign_of_life_is_due() -> None:
    scene = Scene(ttl_s=5.0)
    for number in range(2 * ROOM_BYTES // PIECE_BYTES):
        scene.daemon_says(id=number, result={"text": "x" * PIECE_BYTES})
    assert not scene.far.has_room
    scene.run(TICK_S)
    assert scene.far.has_room


def test_what_is_lost_is_asked_for_as_soon_as_something_behind_it_arrives() -> None:
    scene = Scene(ttl_s=5.0)
    lost = scene.daemon_says_in_vain(id=1, result={})
    behind = scene.daemon_says(id=2, result={})
    scene.run(0.25)  # a sign of life is due after 1.25 s
    assert scene.to_client == [lost, behind]


def test_what_is_lost_is_asked_for_while_much_else_is_said() -> None:
    scene = Scene(ttl_s=5.0)
    lost = scene.daemon_says_in_vain(id=1, result={})
    for number in range(20):
        scene.say("state.get", number)
        scene.run(0.02)
    assert scene.to_client == [lost]


def test_what_is_behind_is_asked_for_at_intervals_until_it_is_there() -> None:
    scene, times_s = Scene(ttl_s=5.0), []

    def seen(ask: Ask, _now_s: float) -> Ask:
        if ask.again:
            times_s.append(scene.now_s)
        return replace(ask, again=ask.again and len(times_s) > 3)

    scene.look(seen)
    lost = scene.daemon_says_in_vain(id=1, result={})
    scene.run(3.0)
    assert scene.to_client == [lost]
    waits_s = [after - before for before, after in pairwise(times_s)]
    assert len(waits_s) == 3
    assert all(BEHIND_S <= wait_s <= BEHIND_S + 2 * TICK_S for wait_s in waits_s)


def test_what_comes_twice_is_not_asked_for_again() -> None:
    scene = Scene(Weather(twice=1.0), ttl_s=5.0)
    again = []

    def seen(ask: Ask, _now_s: float) -> Ask:
        again.append(ask.again)
        return ask

    scene.look(seen)
    lines = [scene.daemon_says(id=number, result={}) for number in range(3)]
    scene.run(3.0)
    assert scene.to_client == lines
    assert again
    assert not any(again)


def test_little_is_sent_again_at_once() -> None:
    scene = Scene()
    scene.weather.cut = True
    for number in range(2 * ROOM_BYTES // 10_000):
        scene.daemon_says(id=number, result={"text": "x" * 10_000})
    before = scene.carried
    scene.far.asked(Ask("live", again=True), b"", scene.far_now_s)
    assert 0 < (scene.carried - before) * 10_000 <= AGAIN_BYTES + 10_000


def test_a_line_that_is_not_taken_is_sent_again_but_not_in_every_tick() -> None:
    scene = Scene(ttl_s=5.0)
    times_s = []

    def seen(ask: Ask, _now_s: float) -> Ask | None:
        if ask.op != "line":
            return ask
        times_s.append(scene.now_s)
        return None  # a gateway that does not get round to it

    scene.look(seen)
    scene.say("state.get", 1)
    scene.run(2.0)
    waits_s = [after - before for before, after in pairwise(times_s)]
    assert len(waits_s) >= 3
    assert all(AGAIN_AFTER_S <= wait_s <= AGAIN_AFTER_S + 2 * TICK_S for wait_s in waits_s)


def test_after_the_end_the_client_gets_nothing_more() -> None:
    scene = Scene(Weather(delay_s=1.5))
    scene.daemon_says(id=1, result={})
    scene.run(3.0)
    assert [len(scene.told), *scene.reasons] == [1, "unreachable"]


@pytest.mark.parametrize(("asked_s", "given_s"), [(None, 1.0), (0.01, 0.3), (3600.0, 5.0)])
def test_no_portal_lets_a_session_live_as_long_as_it_likes(
    asked_s: float | None, given_s: float
) -> None:
    far = FarSession(
        Ask("open", ttl_s=asked_s),
        100.0,
        session="s1",
        voided=VOIDED,
        to_daemon=lambda _line: None,
        push=lambda _push, _piece: None,
    )
    assert not far.is_lost(100.0 + given_s - 0.01)
    assert far.is_lost(100.0 + given_s + 0.01)


def test_a_gateway_whose_clock_has_jumped_is_believed_from_its_next_answer_on() -> None:
    scene = Scene(ttl_s=2.0)
    scene.run(1.0)
    scene.far_ahead_s += 0.8
    scene.run(0.5)
    scene.say("motion.open", 1)
    scene.run(0.1)
    assert [request["id"] for request in scene.asked] == [1]
    assert scene.asked[0]["params"]["sent_s"] == pytest.approx(scene.far_now_s - 0.1, abs=0.01)


def test_an_answer_that_was_long_under_way_says_little_about_the_gateways_clock() -> None:
    scene = Scene(ttl_s=5.0)
    answer = Reply(0, 0, scene.far_now_s)
    scene.near.replied(answer, scene.now_s, scene.now_s + 0.002)
    scene.now_s += 1.4
    scene.near.replied(answer, scene.now_s - 1.4, scene.now_s)
    scene.say("motion.open", 1)
    scene.run(0.1)
    assert [request["id"] for request in scene.asked] == [1]


def test_the_daemons_end_comes_behind_all_that_it_has_said() -> None:
    scene = Scene(Weather(loss=0.5, delay_s=0.01), ttl_s=5.0, seed=3)
    line = scene.daemon_says(id=1, result={})
    scene.far.ended()
    scene.run(4.0)
    assert scene.to_client == [line]
    assert scene.near.ended
    before = scene.carried
    scene.run(1.0)
    assert scene.carried == before  # the end is the end: no life is shown


def test_the_end_of_the_clients_lines_comes_behind_them() -> None:
    scene = Scene(Weather(loss=0.5, delay_s=0.01), ttl_s=5.0, seed=3)
    scene.say("state.get", 1)
    scene.near.half_closed(scene.now_s)
    scene.run(4.0)
    assert len(scene.to_daemon) == 2
    assert scene.to_daemon[-1] is None


def test_a_portal_that_confirms_nothing_fills_no_memory_with_refusals() -> None:
    scene = Scene()
    scene.weather.cut = True
    late = b'{"jsonrpc":"2.0","id":"%b","method":"motion.open"}\n' % (b"x" * 128)
    kept_bytes = []
    for number in range(1, 10_001):
        scene.far.asked(Ask("line", number, at_s=0.0), late, scene.far_now_s)
        kept_bytes.append(scene.far._outbox.size_bytes)
    assert max(kept_bytes) < MOST_UNCONFIRMED_BYTES + 1000
    scene.far.asked(Ask("live", got=10_000), b"", scene.far_now_s)
    took = scene.far.reply(scene.far_now_s).took
    assert took < 10_000
    scene.far.asked(Ask("line", took + 1), b'{"id":1}\n', scene.far_now_s)
    assert scene.to_daemon == [b'{"id":1}\n']


def test_only_a_client_itself_renews_a_lease_with_a_time_to_live_of_its_own() -> None:
    scene = Scene()
    renews = [scene.far.renews]
    granted, refused = {"result": {"number": 1}}, {"error": {"code": 1, "message": "no"}}
    for method, params, answer in (
        ("lease.acquire", {"ttl_s": 3.0}, granted),
        ("state.get", {}, granted),
        ("lease.release", {}, granted),
        ("lease.acquire", {"ttl_s": 0.01}, {}),  # refused by the gateway: nothing has changed
        ("lease.acquire", {"purpose": 5}, refused),  # by the daemon: nor has it here
        ("lease.acquire", {"purpose": "x"}, granted),
        ("lease.acquire", {"ttl_s": True}, refused),
        ("lease.take", {"why": "x", "ttl_s": 1}, granted),
        ("lease.take", {"why": "x"}, granted),
    ):
        scene.say(method, 1, **params)
        scene.run(0.1)
        if answer:
            scene.daemon_says(id=1, **answer)
        renews.append(scene.far.renews)
    assert renews == [True, False, False, False, False, False, True, True, False, True]


@pytest.mark.parametrize(
    ("line", "may"),
    [
        (b'{"id":1,"method":"state.subscribe","params":{"hz":50}}\n', False),
        (b'{"id":1,"method":"motion.open"}\n', False),
        (b'{"id":1,"method":"lease.acquire"}\n', True),
        (b'{"id":1,"method":"lease.resume","params":{"token":"x"}}\n', True),
        (b'{"id":1,"method":"l\\u0065ase.take"}\n', True),
    ],
)
def test_a_session_that_has_asked_for_no_lease_has_none_to_renew(line: bytes, may: bool) -> None:
    scene = Scene()
    assert not scene.far.may_lease
    scene.write(line)
    scene.run(0.1)
    assert scene.far.may_lease == may
    scene.say("state.get", 2)
    scene.run(0.1)
    assert scene.far.may_lease == may


def test_a_lease_that_is_waited_for_is_renewed_as_its_own_request_says() -> None:
    scene = Scene()
    scene.say("lease.acquire", 1, wait_s=60.0, ttl_s=0.5)
    scene.say("lease.acquire", 2)
    scene.run(0.1)
    scene.daemon_says(id=2, error={"code": 1, "message": "held"})
    scene.daemon_says(id=3, result={})
    assert scene.far.renews
    scene.daemon_says(id=1, result={"number": 7})
    assert not scene.far.renews


def test_two_introductions_with_one_id_both_say_where_the_gripper_is_met() -> None:
    scene = Scene()
    scene.near.opened({"site": "lab"})
    for method in ("hello", "health", "hello"):
        scene.say(method, 1)
    scene.run(0.1)
    for result in ({"channel": "can0"}, {"verdict": "ok"}, {"channel": "can0"}, {"other": 1}):
        scene.daemon_says(id=1, result=result)
    scene.run(0.1)
    first, health, second, other = (told["result"] for told in scene.told)
    assert first == second
    assert first["channel"] == "lab.left"
    assert health["verdict"] == "ok"
    assert "channel" not in health
    assert other == {"other": 1}


def test_hello_says_by_which_way_it_came() -> None:
    scene = Scene()
    scene.near.opened({"site": "lab", "gripper": "left", "user": "op1@lab"})
    scene.say("hello", 3, client="x")
    scene.run(0.1)
    scene.daemon_says(id=2, result={"channel": "can0"})
    scene.daemon_says(id=3, result={"channel": "can0", "stop_socket": "/run/can0.stop.sock"})
    scene.daemon_says(id=3, result={"channel": "can0"})
    scene.run(0.1)
    first, hello, later = (told["result"] for told in scene.told)
    assert first == later == {"channel": "can0"}
    assert hello["channel"] == "lab.left"
    assert hello["stop_socket"] == "/run/lab.left.stop.sock"
    assert hello["remote"] == {
        "site": "lab",
        "gripper": "left",
        "user": "op1@lab",
        "channel": "can0",
    }


@pytest.mark.parametrize(
    "line",
    [
        b'{"jsonrpc":"2.0","id":3,"method":"state.get","params":{"client":"hello"}}\n',
        b'{"jsonrpc":"2.0","id":[3],"method":"hello"}\n',
        b'{"jsonrpc":"2.0","id":null,"method":"hello"}\n',
        b'{"jsonrpc":"2.0","method":"hello"}\n',
        b'[{"jsonrpc":"2.0","id":3,"method":"hello"}]\n',
        b'{"jsonrpc":"2.0","id":3,"method":["hello"]}\n',
        b'"hello"\n',
    ],
)
def test_an_answer_to_anything_else_arrives_as_it_is(line: bytes) -> None:
    scene = Scene()
    scene.write(line)
    scene.say("hello", 4)
    answers = [scene.daemon_says(id=number, result={}) for number in (3, None)]
    event = scene.daemon_says(method="event", params={})
    scene.run(0.1)
    assert scene.to_daemon[0] == line
    assert scene.to_client == [*answers, event]


@pytest.mark.parametrize(
    "line",
    [
        b'{"jsonrpc":"2.0","id":3,"method":"\\u0068ello"}\n',
        b'\x0c{"jsonrpc":"2.0","id":3,"method":"hello"}\n',
    ],
)
def test_hello_in_any_spelling_names_the_sockets_of_this_machine(line: bytes) -> None:
    scene = Scene()
    scene.write(line)
    scene.run(0.1)
    scene.daemon_says(id=3, result={"channel": "can0", "stop_socket": "/run/can0.stop.sock"})
    scene.run(0.1)
    assert scene.told[0]["result"]["channel"] == "lab.left"
    assert scene.told[0]["result"]["stop_socket"] == "/run/lab.left.stop.sock"


def test_what_is_refused_for_its_id_changes_no_later_answer() -> None:
    scene = Scene()
    scene.write(b'{"jsonrpc":"2.0","id":true,"method":"hello"}\n')
    scene.say("state.get", 1)
    scene.run(0.1)
    scene.daemon_says(id=None, error={"code": -32600, "message": "no"})
    state = scene.daemon_says(id=1, result={"mode": "idle"})
    scene.run(0.1)
    assert scene.to_client[-1] == state


def test_a_stop_is_left_until_the_gateway_has_taken_it() -> None:
    scene = Scene()
    scene.weather.cut = True
    scene.say("motion.open", 1)
    scene.say("stop", 2, level="disable")
    scene.say("state.get", 3, why="stop")
    assert [json.loads(line)["id"] for line in scene.near.stops_left()] == [2]
    scene.weather.cut = False
    scene.run(0.9)
    assert scene.near.stops_left() == []


def test_health_says_how_the_way_is_protected() -> None:
    scene = Scene()
    scene.near.opened({"site": "lab", "insecure": True, "certificate_expires_s": None})
    scene.say("health", 3)
    scene.run(0.1)
    scene.daemon_says(id=3, result={"verdict": "ok", "remote": None})
    scene.say("health", 4)
    scene.run(0.1)
    scene.daemon_says(id=4, error={"code": 1, "message": "no"})
    scene.run(0.1)
    health, refused = scene.told
    protection = {"insecure": True, "certificate_expires_s": None}
    assert health["result"] == {"verdict": "ok", "remote": protection}
    assert refused["error"] == {"code": 1, "message": "no"}


def test_a_request_carries_the_stops_that_the_portal_knew_of() -> None:
    scene = Scene()
    scene.far.generation = 4
    scene.daemon_says(method="event", params={})
    scene.run(0.1)
    scene.say("motion.open", 1)
    scene.far.generation = 5  # a stop, which the portal does not know of yet
    scene.run(0.1)
    assert scene.asked[0]["params"]["stop_generation"] == 4
    scene.run(1.0)
    scene.say("motion.close", 2)
    scene.run(0.1)
    assert scene.asked[1]["params"]["stop_generation"] == 5
    scene.far.generation = 3  # a count that comes late: there are not fewer stops now
    scene.daemon_says(method="event", params={})
    scene.run(0.1)
    scene.say("motion.open", 3)
    scene.run(0.1)
    assert scene.asked[2]["params"]["stop_generation"] == 5


def test_a_line_without_an_end_ends_its_session_before_it_fills_the_portal() -> None:
    scene = Scene(ttl_s=1e6)
    pieces, number = 0, 0
    while not scene.near.ended:
        number += 1
        scene.near.pushed(Push(number, more=True), b"x" * PIECE_BYTES, scene.now_s)
        pieces += 1
        assert pieces * PIECE_BYTES <= MAX_ANSWER_BYTES + PIECE_BYTES
    assert scene.reasons == ["unreachable"]
    assert pieces * PIECE_BYTES > MAX_ANSWER_BYTES


NO_INTRODUCTIONS: tuple[bytes, ...] = (
    *(b"[" * 60_000 + b"\n", b"7\n", b'["id"]\n', b"\xff\n"),
    *(b'{"id":1,"result":7}\n', b'{"id":[1],"result":{}}\n', b'{"id":1,"error":{}}\n'),
)


@pytest.mark.parametrize("line", NO_INTRODUCTIONS, ids=range(len(NO_INTRODUCTIONS)))
def test_what_answers_a_greeting_and_is_no_answer_goes_to_the_client_as_it_came(
    line: bytes,
) -> None:
    scene = Scene()
    scene.say("hello", 1)
    scene.run(0.1)
    scene.near.pushed(Push(1), line, scene.now_s)
    scene.near.pushed(Push(2), b'{"id":2,"result":{}}\n', scene.now_s)
    assert scene.to_client == [line, b'{"id":2,"result":{}}\n']
