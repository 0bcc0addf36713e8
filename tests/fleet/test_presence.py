"""Who is silent, and that each silence stops each gripper, in virtual time."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_fleet.far.presence import DeadMan, Presence
from tests.properties import examples

TTL_S = 1.0
LOOK_S = 0.05


@dataclass
class Gripper:
    """A gripper with its daemon; looked at as the switch does."""

    presence: Presence
    is_stopped: bool = False
    answers: bool = True
    stops: int = 0

    def __post_init__(self) -> None:
        self.dead_man = DeadMan(self.presence)

    def look(self, now_s: float) -> None:
        if not self.dead_man.is_due(now_s):
            return
        self.dead_man.begin(now_s)
        if self.answers:
            self.is_stopped = True
            self.stops += 1
        self.dead_man.done(confirmed=self.answers)

    def clear(self) -> None:
        self.is_stopped = False
        self.dead_man.lifted()


def present(*users: str, now_s: float = 0.0) -> tuple[Presence, Gripper]:
    """Return users who have just shown life, and a gripper that has been cleared since."""
    presence = Presence(users)
    gripper = Gripper(presence)
    gripper.look(now_s)
    for user in users:
        presence.shown(user, now_s, TTL_S, now_s)
    gripper.clear()
    gripper.look(now_s)
    assert not gripper.is_stopped
    return presence, gripper


def test_at_first_nobody_is_present_and_the_gripper_is_stopped_once() -> None:
    presence = Presence(["supervisor", "nurse"])
    gripper = Gripper(presence)
    for number in range(10):
        gripper.look(number * LOOK_S)
    assert gripper.stops == 1
    assert presence.silent(0.0) == ("supervisor", "nurse")
    assert presence.why(0.0) == "supervisor and nurse are silent, and have to be present"
    presence.shown("nurse", 1.0, TTL_S, 1.0)
    assert presence.why(1.0) == "supervisor is silent, and has to be present"


def test_one_who_is_silent_is_enough_and_his_return_clears_nothing() -> None:
    presence, gripper = present("supervisor", "nurse")
    presence.shown("nurse", 1.0, TTL_S, 1.0)
    gripper.look(1.0)
    assert gripper.stops == 1
    gripper.look(1.01)
    assert gripper.is_stopped
    presence.shown("supervisor", 1.5, TTL_S, 1.5)
    gripper.look(1.5)
    assert gripper.is_stopped
    assert gripper.stops == 2  # at the start, and now
    gripper.clear()
    gripper.look(1.6)
    assert not gripper.is_stopped


def test_a_stop_that_is_cleared_meanwhile_comes_again_each_time() -> None:
    presence = Presence(["supervisor"])
    gripper = Gripper(presence)
    for number in range(1, 6):
        gripper.look(number * LOOK_S)
        assert gripper.is_stopped
        assert gripper.stops == number
        gripper.look(number * LOOK_S)
        assert gripper.stops == number  # nobody has cleared it since
        gripper.clear()


def test_what_is_cleared_while_a_stop_is_under_way_is_stopped_again() -> None:
    dead_man = DeadMan(Presence(["supervisor"]))
    dead_man.begin(0.0)
    dead_man.lifted()  # heard of before the answer to the stop
    dead_man.done(confirmed=True)
    assert dead_man.is_due(0.0)


def test_what_is_cleared_while_the_daemon_does_not_answer_is_stopped_when_it_does() -> None:
    _, gripper = present("supervisor")
    gripper.look(2.0)
    gripper.answers = False
    gripper.clear()
    gripper.look(2.1)
    assert not gripper.is_stopped
    gripper.answers = True
    gripper.look(2.2)
    assert gripper.is_stopped


def test_who_was_silent_is_named_when_he_is_back() -> None:
    presence, _ = present("supervisor", "nurse")
    presence.shown("supervisor", 1.0, TTL_S, 1.0)
    presence.shown("nurse", 1.5, TTL_S, 1.5)
    assert presence.why(1.5) == "nurse was silent, and has to be present"


def test_a_stop_that_is_not_confirmed_stays_due_even_when_the_user_is_back() -> None:
    presence, gripper = present("supervisor")
    gripper.answers = False
    gripper.look(2.0)
    presence.shown("supervisor", 2.1, TTL_S, 2.1)
    gripper.look(2.1)
    assert presence.why(2.1) == "supervisor was silent, and has to be present"
    gripper.answers = True
    gripper.look(2.2)
    assert gripper.is_stopped


def test_others_are_not_asked_for_and_prove_nothing() -> None:
    presence = Presence(["supervisor"])
    presence.shown("op1", 1.0, TTL_S, 1.0)
    assert presence.silent(1.0) == ("supervisor",)


@pytest.mark.parametrize("at_s", [None, 8.9])
def test_a_sign_without_a_time_or_that_came_too_late_proves_nothing(at_s: float | None) -> None:
    presence = Presence(["supervisor"])
    presence.shown("supervisor", at_s, TTL_S, 10.0)
    assert presence.silent(10.0) == ("supervisor",)


def test_no_sign_counts_from_the_future() -> None:
    presence = Presence(["supervisor"])
    presence.shown("supervisor", 1e9, TTL_S, 10.0)
    assert presence.silent(10.0 + TTL_S) == ()
    assert presence.silent(10.0 + TTL_S + 0.01) == ("supervisor",)


@examples(100)
@given(
    signs=st.lists(st.tuples(st.floats(0.0, 2.5), st.floats(0.0, 1.5)), min_size=1, max_size=30),
    looks=st.lists(st.floats(0.0, 60.0), max_size=30),
)
def test_no_silence_is_missed_however_seldom_anybody_looks(
    signs: list[tuple[float, float]], looks: list[float]
) -> None:
    """`signs` are the waits between signs of life, and how long each of them is under way."""
    presence, gripper = present("supervisor")
    events: list[tuple[float, float | None]] = [(at_s, None) for at_s in looks]
    sent_s = 0.0
    for wait_s, under_way_s in signs:
        sent_s += wait_s
        events.append((sent_s + under_way_s, sent_s))
    until_s, stops, is_silent = TTL_S, gripper.stops, False
    for now_s, sign_s in sorted(events, key=lambda event: event[0]):
        if now_s > until_s and not is_silent:
            stops, is_silent = stops + 1, True
        if sign_s is None:
            continue
        presence.shown("supervisor", sign_s, TTL_S, now_s)
        if sign_s + TTL_S >= now_s and sign_s + TTL_S > until_s:
            until_s, is_silent = sign_s + TTL_S, False
    gripper.look(now_s)
    assert gripper.is_stopped == (stops > 1)
    assert presence.silences(now_s) == stops
    assert bool(presence.silent(now_s)) == is_silent


@examples(100)
@given(
    acts=st.lists(
        st.tuples(st.sampled_from(["sign", "clear", "deaf", "hears"]), st.floats(0.0, 1.5)),
        max_size=40,
    )
)
def test_whoever_is_silent_the_gripper_is_stopped_after_one_look_that_is_heard(
    acts: list[tuple[str, float]],
) -> None:
    presence = Presence(["supervisor"])
    gripper, now_s = Gripper(presence), 0.0
    for act, wait_s in acts:
        now_s += wait_s
        if act == "sign":
            presence.shown("supervisor", now_s, TTL_S, now_s)
        elif act == "clear":
            gripper.clear()
        else:
            gripper.answers = act == "hears"
        gripper.look(now_s)
        if gripper.answers and presence.silent(now_s):
            assert gripper.is_stopped
