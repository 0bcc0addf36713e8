"""The move to a stop by itself: its ramp in time, its phases and its ends."""

from typing import Any

import pytest

from litegripd.control.motions.move import SPEED_UP_S, Direction, MoveToStop
from litegripd.model.calibration import NOMINAL
from litegripd.model.motion_config import MOVING_KP_NM_RAD, MotionConfig
from litegripd.model.motor import Feedback, MotorPhase, MotorView
from litegripd.model.state import MoveResult
from tests.world import PERIOD_S

SPEED_RAD_S = NOMINAL[0].to_rad(50.0)
LEAD_RAD = MotionConfig().travel_nm / MOVING_KP_NM_RAD


def action(direction: Direction = "close", **config: Any) -> MoveToStop:
    settings = MotionConfig(**config)
    return MoveToStop(
        direction,
        50.0,
        geometry=NOMINAL[0],
        config=settings,
        travel_nm=settings.travel_nm,
        period_s=PERIOD_S,
    )


def at(position_rad: float, torque_nm: float = 0.0) -> MotorView:
    feedback = Feedback(1, position_rad, 0.0, torque_nm, 30, 30, 0.0)
    return MotorView(MotorPhase.ENABLED, feedback)


@pytest.mark.parametrize("periods", [1, 2, 7, 31])
def test_late_ticks_do_not_slow_the_ramp(periods: int) -> None:
    """With jaws that follow ideally, the move takes as long with few ticks as with many."""
    start_rad = position_rad = command_rad = -1.1
    move, now_s = action(), 0.0
    while position_rad < start_rad + 1.0:  # well before the stop
        step = move.step(now_s, at(position_rad))
        assert step.command is not None
        command_rad = step.command.position_rad
        assert command_rad <= start_rad + SPEED_RAD_S * now_s + 1e-9
        position_rad += min(SPEED_RAD_S * periods * PERIOD_S, 1.0)
        now_s += periods * PERIOD_S
    ran_s = now_s - periods * PERIOD_S - 0.5 * SPEED_UP_S
    assert command_rad == pytest.approx(start_rad + SPEED_RAD_S * ran_s)
    assert now_s == pytest.approx(1.0 / SPEED_RAD_S, abs=2 * periods * PERIOD_S)


def test_the_first_command_is_where_the_jaws_are() -> None:
    step = action().step(7.0, at(-0.5))
    assert step.command is not None
    assert step.command.position_rad == pytest.approx(-0.5)


def test_on_the_way_the_velocity_is_fed_forward_and_while_capped_it_is_not() -> None:
    move = action()
    move.step(0.0, at(-0.5))
    half = move.step(0.5 * SPEED_UP_S, at(-0.5)).command
    free = move.step(SPEED_UP_S, at(-0.5)).command
    capped = move.step(0.2, at(-0.5)).command
    assert half is not None
    assert free is not None
    assert capped is not None
    assert half.velocity_rad_s == pytest.approx(0.5 * SPEED_RAD_S)
    assert free.velocity_rad_s == pytest.approx(SPEED_RAD_S)
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
    creep = [-1.6 + 0.21 * SPEED_RAD_S * t * PERIOD_S for t in range(3000)]
    result, _ = run(action(), creep)
    assert (result.ok, result.outcome) == (False, "timed_out")


@pytest.mark.parametrize("settle_s", [0.0, 0.3, 1.0])
def test_settling_lasts_as_long_as_configured(settle_s: float) -> None:
    result, took_s = run(action(settle_s=settle_s), [NOMINAL[0].closed_rad])
    assert result.outcome == "pressed_home"
    assert took_s == pytest.approx(0.25 + settle_s, abs=2 * PERIOD_S)


def test_settling_is_not_checked_for_a_stall_but_for_where_it_ends() -> None:
    closed_rad = NOMINAL[0].closed_rad
    slips = [closed_rad - 0.004] * 60 + [
        closed_rad - 0.064
    ] * 200  # pushed back by something after the stall
    result, _ = run(action(), slips)
    assert (result.ok, result.outcome, result.stalled) == (False, "blocked", True)


def test_it_waits_where_there_is_no_feedback() -> None:
    move = action()
    assert move.step(0.0, MotorView(MotorPhase.ENABLED)).command is None
    assert move.progress() is None
