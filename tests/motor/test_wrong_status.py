"""One answer with a wrong status lets go of nothing; without checksums, such answers come."""

import random

import pytest

from litegripd.model.motor import CanFrame, Feedback, MotorPhase, Status
from litegripd.motor.exchange import CERTAIN_AFTER, StatusJudge
from tests.motor.helpers import gripping, replace_answers
from tests.world import PERIOD_S, World

WRONG = [0x0, 0x2, 0x7, 0x8, 0x9, 0xD, 0xE, 0xF]


def falsify(world: World, status: int, frames: int = 1) -> None:
    """Give the motor's next answers another status, and nonsense beside it."""

    def other(frame: CanFrame) -> CanFrame | None:
        if frame.data[0] >> 4 != Status.ENABLED:
            return None
        head = bytes([status << 4 | frame.data[0] & 0xF])
        return CanFrame(frame.can_id, head + bytes.fromhex("2000FFFFFFFFFF"))

    replace_answers(world, other, frames)


@pytest.mark.parametrize("status", WRONG)
def test_one_wrong_status_is_left_out_altogether(status: int) -> None:
    world, _ = gripping()
    before_rad = world.state.position_rad
    falsify(world, status)
    for _ in range(20):
        world.tick()
        assert world.in_phase(MotorPhase.ENABLED)
        assert world.state.position_rad == pytest.approx(before_rad, abs=0.005)
        assert abs(world.gripper.motor_torque_nm) == pytest.approx(1.0, abs=0.1)
    assert world.state.is_grasped


@pytest.mark.parametrize("status", WRONG)
def test_a_second_answer_that_agrees_is_acted_upon_at_once(status: int) -> None:
    world, _ = gripping()
    falsify(world, status, frames=2)
    world.run(3 * PERIOD_S)
    assert not world.in_phase(MotorPhase.ENABLED)


@pytest.mark.parametrize("fault", [0x8, 0xA, 0xD])
def test_a_true_fault_is_acted_upon_one_period_later(fault: int) -> None:
    world, _ = gripping()
    world.gripper.latch_fault(fault)
    world.run(3 * PERIOD_S)  # the command that is answered with it, the answer, and one more
    assert world.in_phase(MotorPhase.FAULT)


@pytest.mark.parametrize("status", [0x0, 0x9])
def test_a_wrong_status_after_a_silence_does_not_end_the_hold(status: int) -> None:
    world, _ = gripping()
    world.lose_from_motor = lambda _frame: True
    world.run(0.04)
    assert world.in_phase(MotorPhase.SILENT)
    falsify(world, status)
    world.run(0.2)
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.state.is_grasped


def reported(status: int, at_s: float) -> Feedback:
    return Feedback(status, 0.0, 0.0, 0.0, 30, 30, at_s)


def test_a_doubled_frame_proves_no_more_than_it_did_once() -> None:
    judge = StatusJudge()
    assert not judge.accepts(reported(9, 1.0))
    assert not judge.accepts(reported(9, 1.0))
    assert judge.accepts(reported(9, 1.005))


def test_a_doubled_frame_is_none_of_those_that_differ() -> None:
    judge = StatusJudge()
    for status, at_s in ((9, 1.0), (9, 1.0), (8, 1.005)):
        assert not judge.accepts(reported(status, at_s))
    assert judge.accepts(reported(10, 1.01))


def test_a_right_answer_between_two_wrong_ones_ends_the_doubt() -> None:
    judge = StatusJudge()
    for tick in range(0, 20, 2):
        assert not judge.accepts(reported(9, tick * 0.005))
        assert judge.accepts(reported(1, (tick + 1) * 0.005))
    for tick in range(CERTAIN_AFTER - 1):  # as many that differ as at first
        assert not judge.accepts(reported(8 + tick, 1.0 + tick * 0.005))


def test_answers_that_differ_are_believed_in_the_end() -> None:
    judge = StatusJudge()
    answers = [judge.accepts(reported(8 + tick, tick * 0.005)) for tick in range(CERTAIN_AFTER)]
    assert answers == [False] * (CERTAIN_AFTER - 1) + [True]


def damaged(frame: CanFrame, chance: random.Random) -> CanFrame:
    """Change one hexadecimal digit of a frame's line, of its id or of its data."""
    digits = f"{frame.can_id:03x}{frame.data.hex()}"
    place = chance.randrange(len(digits))
    digits = digits[:place] + chance.choice("0123456789abcdef") + digits[place + 1 :]
    return CanFrame(int(digits[:3], 16) & 0x7FF, bytes.fromhex(digits[3:]))


@pytest.mark.parametrize("seed", range(3))
def test_a_damaged_line_in_twenty_ends_no_hold(seed: int) -> None:
    world, _ = gripping()
    chance = random.Random(seed)
    replace_answers(world, lambda frame: damaged(frame, chance) if chance.random() < 0.05 else None)
    before_mm = world.gripper.opening_mm
    for _ in range(round(20.0 / PERIOD_S)):
        world.tick()
        assert abs(world.gripper.opening_mm - before_mm) < 1.0
        assert abs(world.gripper.motor_torque_nm) < 2.0
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.machine.motor.counters.foreign_commands == 0
    assert world.gripper.motor.status == Status.ENABLED
    world.lose_from_motor = lambda _frame: False
    world.run(0.5)
    assert abs(world.gripper.motor_torque_nm) == pytest.approx(1.0, abs=0.15)
    assert world.state.is_grasped
