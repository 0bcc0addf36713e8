"""The move to a stop by itself: its ramp in time, its phases and its ends."""

from typing import Any

import pytest

from litegripd.control.limiter import DEFAULT_GAINS
from litegripd.control.motions.move import Direction, MoveToStop
from litegripd.model.gripper import Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MotorPhase, MotorView
from litegripd.model.state import MoveResult
from tests.world import PERIOD_S

MM_RAD = 74.8
LEAD_RAD = 4.0 / MM_RAD


def action(direction: Direction = "close", **config: Any) -> MoveToStop:
    return MoveToStop(
        direction,
        50.0,
        geometry=Geometry(0.114, -1.491, MM_RAD),
        config=MotionConfig(**config),
        gains=DEFAULT_GAINS,
        period_s=PERIOD_S,
    )


def at(position_rad: float, torque_nm: float = 0.0) -> MotorView:
    feedback = Feedback(1, position_rad, 0.0, torque_nm, 30, 30, 0.0)
    return MotorView(MotorPhase.ENABLED, feedback)


@pytest.mark.parametrize("periods", [1, 2, 7, 31])
def test_late_ticks_do_not_slow_the_ramp(periods: int) -> None:
    """With jaws that follow ideally, the move takes as long with few ticks as with many."""
    move, now_s, position_rad = action(), 0.0, -1.0
    command_rad = position_rad
    while position_rad < 0.0:
        step = move.step(now_s, at(position_rad))
        assert step.command is not None
        command_rad = step.command.position_rad
        assert command_rad <= -1.0 + 50.0 / MM_RAD * now_s + 1e-9
        position_rad += min(50.0 / MM_RAD * periods * PERIOD_S, 1.0)
        now_s += periods * PERIOD_S
    assert command_rad == pytest.approx(-1.0 + 50.0 / MM_RAD * (now_s - periods * PERIOD_S))
    assert now_s == pytest.approx(MM_RAD / 50.0, abs=2 * periods * PERIOD_S)


def test_the_first_command_is_where_the_jaws_are() -> None:
    step = action().step(7.0, at(-0.5))
    assert step.command is not None
    assert step.command.position_rad == pytest.approx(-0.5)


def test_on_the_way_the_velocity_is_fed_forward_and_while_capped_it_is_not() -> None:
    move = action()
    move.step(0.0, at(-0.5))
    free = move.step(0.005, at(-0.5)).command
    capped = move.step(0.2, at(-0.5)).command
    assert free is not None
    assert capped is not None
    assert free.velocity_rad_s == pytest.approx(50.0 / MM_RAD)
    assert capped.velocity_rad_s == 0.0
    assert capped.position_rad == pytest.approx(-0.5 + LEAD_RAD)


def run(move: MoveToStop, path: list[float], until_s: float = 60.0) -> tuple[MoveResult, float]:
    """Step along a path, whose last position stays, until there is an outcome."""
    tick = 0
    while tick * PERIOD_S < until_s:
        step = move.step(tick * PERIOD_S, at(path[min(tick, len(path) - 1)]))
        if step.outcome is not None:
            assert isinstance(step.outcome, MoveResult)
            return step.outcome, tick * PERIOD_S
        tick += 1
    raise AssertionError("no outcome")


def test_jaws_that_creep_for_ever_time_out() -> None:
    """Too fast for a stall, too slow to arrive."""
    creep = [-1.0 + 0.14 * t * PERIOD_S for t in range(3000)]
    result, _ = run(action(), creep)
    assert (result.ok, result.outcome) == (False, "timed_out")


@pytest.mark.parametrize("settle_s", [0.0, 0.3, 1.0])
def test_settling_lasts_as_long_as_configured(settle_s: float) -> None:
    result, took_s = run(action(settle_s=settle_s), [0.114])
    assert result.outcome == "pressed_home"
    assert took_s == pytest.approx(0.25 + settle_s, abs=2 * PERIOD_S)


def test_settling_is_not_checked_for_a_stall_but_for_where_it_ends() -> None:
    slips = [0.11] * 60 + [0.05] * 200  # pushed back by something after the stall
    result, _ = run(action(), slips)
    assert (result.ok, result.outcome, result.stalled) == (False, "blocked", True)


def test_it_waits_where_there_is_no_feedback() -> None:
    move = action()
    assert move.step(0.0, MotorView(MotorPhase.ENABLED)).command is None
    assert move.progress() is None
