"""How long a motor may be silent, or its position in doubt: a time, whatever the rate."""

import pytest

from litegripd.model.motor import MotorPhase
from tests.motor.test_plausibility import jump
from tests.motor.test_silence import moving, mute
from tests.world import CAN_ID, found_world, is_command

PERIODS_S = [0.010, 0.005, 0.002, 0.001]


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_silence_ends_a_motion_after_the_same_time_at_any_rate(period_s: float) -> None:
    world, _ = moving(period_s=period_s)
    mute(world)
    world.tick()  # takes the last answer, sends the first command that stays unanswered
    began_s = world.now_s
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 0.1)
    assert world.now_s - began_s == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("way", ["lose_from_motor", "lose_to_motor"])
def test_a_silence_of_10_ms_ends_no_motion(period_s: float, way: str) -> None:
    world, client = moving(period_s=period_s)
    setattr(world, way, lambda _frame: True)
    world.run(0.010)
    setattr(world, way, lambda _frame: False)
    world.run(0.2)
    assert world.in_phase(MotorPhase.ENABLED)
    client.read()
    assert not [answer for answer in client.answers.values() if "error" in answer]


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_no_more_commands_are_repeated_than_a_queue_holds(period_s: float) -> None:
    """What lies in the queue of a dead bus is replayed when power returns."""
    world, _ = moving(period_s=period_s)
    mute(world)
    world.tick()
    since_s = world.now_s - period_s / 2
    world.run(0.1)
    own = [s.frame for s in world.sent if s.at_s > since_s and s.frame.can_id == CAN_ID]
    assert 2 <= len([frame for frame in own if is_command(frame)]) <= 7


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_an_enabling_without_answers_leaves_no_more_in_a_queue(period_s: float) -> None:
    world, client = found_world(period_s=period_s)
    world.run(0.2)
    since_s = world.now_s
    world.lose_from_motor = lambda frame: frame.data[2] != 0x33  # all but the registers
    client.send("motor.enable")
    world.run(0.15)
    own = [s.frame for s in world.sent if s.at_s > since_s and s.frame.can_id == CAN_ID]
    assert 1 <= len(own) <= 8


@pytest.mark.parametrize(("period_s", "frames"), [(0.01, 1), (0.005, 2), (0.002, 7), (0.001, 14)])
def test_positions_in_doubt_for_less_than_15_ms_end_nothing(period_s: float, frames: int) -> None:
    world, client = moving(period_s=period_s)
    jump(world, 1.0, frames)
    world.run(0.3)
    assert world.machine.motor.counters.implausible_frames == frames
    assert world.in_phase(MotorPhase.ENABLED)
    client.read()
    assert not [answer for answer in client.answers.values() if "error" in answer]


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_position_in_doubt_for_15_ms_is_a_fault(period_s: float) -> None:
    world, client = moving(period_s=period_s)
    began_s = world.now_s
    jump(world, 1.0)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLING, MotorPhase.DISABLED), 0.1)
    assert world.now_s - began_s <= 0.015 + 2 * period_s + 1e-6
    assert client.refusal("motor.enable") == "implausible_feedback"
