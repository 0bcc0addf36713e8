"""What a network gives back after a silence is old motion: it is not followed."""

import random

import pytest

from litegripd.teleop.intake import Backlog
from tests.control.teleop_scene import Follower, following, packed, sweep
from tests.world import PERIOD_S

CUT_S = 5.0
ELSEWHERE = sweep(0.5, 0.1, 1.0)


def cut(follower: Follower, given_back_in_s: float) -> None:
    """Cut the cable for a while; the leader's frames of that time come after its repair."""
    began_s = follower.world.now_s
    follower.world.run(CUT_S)
    mended_s = follower.world.now_s
    count = round(CUT_S / PERIOD_S)
    for number in range(count):
        sent_s = began_s + number * PERIOD_S
        share = number / count
        delay_s = share * given_back_in_s
        follower.put(packed(ELSEWHERE(share * CUT_S), sent_s), "", delay_s)
    assert follower.world.now_s == mended_s


@pytest.mark.parametrize("given_back_in_s", [0.0, 0.05, 0.4, 1.5])
def test_what_was_sent_during_a_cut_is_not_followed_afterwards(given_back_in_s: float) -> None:
    """At the end of the cut the leader is where it was before; in between it was elsewhere."""
    follower = following()
    before = follower.world.openness
    cut(follower, given_back_in_s)
    # Old frames alone come first: the network gives them back in their order.
    seen = follower.world.track(given_back_in_s, lambda: follower.world.openness)
    seen += follower.lead(lambda _t: before, 1.0, each=lambda: follower.world.openness)
    assert max(seen) - min(seen) < 0.03
    assert follower.status()["late"] > 800
    assert follower.status()["phase"] == "following"


def test_fresh_frames_after_a_silence_are_followed_at_once() -> None:
    follower = following()
    follower.world.run(3.0)
    follower.say(0.5)
    follower.world.tick()
    status = follower.status()
    assert (status["phase"], status["late"], status["stale"]) == ("following", 0, False)


@pytest.mark.parametrize("jitter_s", [0.0, 0.1])
def test_a_clock_that_is_another_one_after_a_silence_is_believed_soon(jitter_s: float) -> None:
    """Its frames look old, but they do not catch up."""
    follower = following()
    follower.world.run(1.0)
    dice = random.Random(3)
    ticks = 0
    while follower.status()["phase"] == "stale":
        stamp_s = follower.world.now_s - 500.0 - jitter_s * dice.random()
        follower.put(packed(0.45, stamp_s))
        follower.world.tick()
        ticks += 1
        assert ticks < 200
    assert 0.19 < ticks * PERIOD_S < 0.6


def test_clocks_may_drift_for_hours() -> None:
    backlog = Backlog(0.2)
    backlog.begin(100.0, 0.0)
    for second in range(36_000):  # a fast sender or a slow one, by 100 millionths
        offset_s = 100.0 + 1e-4 * second
        assert not backlog.holds(offset_s, float(second))
        backlog.accept(offset_s, float(second))
    assert backlog.holds(offset_s + 0.25, 36_000.1)
    backlog.begin(50.0, 40_000.0)
    assert not backlog.holds(50.1, 40_000.0)
    assert backlog.holds(50.3, 40_000.0)
