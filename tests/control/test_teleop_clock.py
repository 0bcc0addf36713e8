"""A leader's clock that leaps ahead: it is another leader, or one that restarted."""

from itertools import pairwise

import pytest

from litegripd.model.teleop import Arrival
from litegripd.teleop.intake import Intake
from tests.control.teleop_scene import CODE_RAD, MM_RAD, following, packed
from tests.world import PERIOD_S


def taken(*frames: tuple[float, float, float]) -> Intake:
    """Return an intake that has taken frames: openness, the sender's time, and that of arrival."""
    intake = Intake(watchdog_s=5.0)
    for openness, stamp_s, at_s in frames:
        intake.take(Arrival(packed(openness, stamp_s), at_s))
    return intake


@pytest.mark.parametrize("apart_s", [0.0, 0.005, 0.5, 3.0])
@pytest.mark.parametrize(("beyond_s", "begins"), [(-0.001, 1), (0.001, 2), (1000.0, 2)])
def test_a_leap_is_more_than_a_second_beyond_the_time_that_has_passed(
    apart_s: float, beyond_s: float, begins: int
) -> None:
    leap_s = 1.0 + apart_s + beyond_s
    first = (0.5, 100.0, 10.0), (0.6, 100.0 + leap_s, 10.0 + apart_s)
    assert taken(*first).begins == 1
    intake = taken(*first, (0.6, 100.0 + leap_s, 10.0 + apart_s))
    assert intake.begins == begins
    assert intake.frames == 3
    assert intake.latest is not None
    assert intake.latest.openness == 0.6
    assert intake.rate_1_s(10.0 + apart_s) == 0.0


@pytest.mark.parametrize("stamp_s", [102.0, 5000.0, 1e300])
def test_a_single_frame_of_another_time_is_damaged_and_costs_no_other(stamp_s: float) -> None:
    """A leap at once would make those that follow the frames of another leader."""
    frames = [(0.5, 100.0 + 0.01 * number, 10.0 + 0.01 * number) for number in range(50)]
    frames.insert(20, (0.9, stamp_s, 10.195))
    frames.insert(30, (0.9, stamp_s * 2.0, 10.285))
    intake = taken(*frames)
    assert (intake.begins, intake.frames, intake.other_leaders) == (1, 50, 0)
    assert intake.out_of_order == 2
    assert intake.latest is not None
    assert intake.latest.openness == 0.5


def test_after_a_leap_the_follower_aligns_and_does_not_jump() -> None:
    follower = following()
    began_s, leap_s = follower.world.now_s, 5000.0
    for tick in range(40):
        follower.put(packed(0.9, follower.world.now_s + leap_s))
        follower.world.tick()
        assert (follower.status()["phase"] == "aligning") is (tick > 0), tick  # it is confirmed
    commands = [command for _, command in follower.world.commands_since(began_s)]
    steps = [abs(b.position_rad - a.position_rad) for a, b in pairwise(commands)]
    assert max(steps) < 50.0 / MM_RAD * PERIOD_S + 2 * CODE_RAD
    assert max(abs(command.velocity_rad_s) for command in commands) < 50.0 / MM_RAD + 0.02
    for _ in range(300):
        follower.put(packed(0.9, follower.world.now_s + leap_s))
        follower.world.tick()
    status = follower.status()
    assert (status["phase"], status["late"], status["other_leaders"]) == ("following", 0, 0)
    assert follower.world.openness == pytest.approx(0.9, abs=0.01)


def test_after_a_leap_the_new_clock_is_the_one_that_counts() -> None:
    """What lay in the network during a silence is old by the new clock, too."""
    follower = following()
    for _ in range(60):
        follower.put(packed(0.5, follower.world.now_s + 5000.0))
        follower.world.tick()
    sent_s = follower.world.now_s
    follower.world.run(1.0)
    follower.put(packed(0.1, sent_s + 5000.1))
    follower.world.tick()
    status = follower.status()
    assert (status["late"], status["phase"]) == (1, "stale")
