"""When no zero is set: to a motor that does not say that it is disabled, or with moving jaws."""

import struct

import pytest

from litegripd.model.motor import (
    CanFrame,
    DisableMotor,
    EnableMotor,
    MotorPhase,
    SetZero,
    Status,
)
from litegripd.motor import codec
from tests.motor.bench import (
    CAN_ID,
    PERIOD_S,
    Bench,
    LosesFirst,
    ended,
    everything,
    feedback_frame,
    is_zero,
    nothing,
    reason,
    set_zero,
)

CODE_RAD = 25.0 / 65535


def test_nothing_is_sent_to_a_motor_that_does_not_say_that_it_is_disabled() -> None:
    """It was disabled when it last answered, which is not enough."""
    bench = Bench().started()
    bench.lose_from_motor = everything
    bench.tick()
    zero = set_zero(bench)
    assert reason(zero) == "motor_silent"
    assert not zero.is_uncertain
    assert not bench.times_of(is_zero)


@pytest.mark.parametrize("status", [1, 8, 9, 13, 2, 15])
@pytest.mark.parametrize("after", [0.0, 0.03])
def test_a_motor_that_says_anything_but_disabled_gets_no_frame(status: int, after: float) -> None:
    bench = Bench().started()
    bench.tick(SetZero())
    bench.run(after)
    bench.lose_to_motor = everything
    bench.receive()
    bench.step()
    bench.inject(feedback_frame(-0.5, status))
    zero = ended(bench)
    assert reason(zero) == "not_confirmed"
    assert "disabled" in (zero.failure.message if zero.failure else "")
    assert not zero.is_uncertain
    bench.run(0.5)
    assert not bench.times_of(is_zero)


def test_it_is_refused_while_the_motor_is_enabled() -> None:
    bench = Bench().enabled()
    since_s = bench.now_s + PERIOD_S / 2
    bench.tick(SetZero())
    assert reason(bench.view.zero) == "not_confirmed"
    assert not bench.view.zero.is_uncertain
    bench.run(0.5)
    assert bench.view.phase is MotorPhase.ENABLED
    assert not bench.times_of(is_zero)
    assert len(bench.times_of(lambda frame: frame.can_id == CAN_ID, since_s)) == 101


def test_it_is_refused_while_the_motor_is_being_enabled_or_disabled() -> None:
    bench = Bench().started()
    bench.tick(EnableMotor(3, 0.2))
    bench.tick(SetZero())
    phases, zeros = [bench.view.phase], [bench.view.zero]
    bench.run_until(lambda: bench.view.phase is MotorPhase.ENABLED)
    bench.lose_to_motor = LosesFirst(5, lambda frame: frame.data == codec.DISABLE)
    bench.tick(DisableMotor())
    bench.tick(SetZero())
    phases, zeros = [*phases, bench.view.phase], [*zeros, bench.view.zero]
    assert phases == [MotorPhase.ENABLING, MotorPhase.DISABLING]
    assert [reason(zero) for zero in zeros] == ["not_confirmed"] * 2
    bench.run(0.5)
    assert not bench.times_of(is_zero)


def test_it_is_refused_by_name_of_the_fault_while_the_motor_has_one() -> None:
    bench = Bench().faulty()
    bench.tick(SetZero())
    assert reason(bench.view.zero) == "motor_fault"
    bench.run(0.5)
    assert not bench.times_of(is_zero)


def test_it_is_refused_before_the_motor_is_known_and_while_it_is_silent() -> None:
    bench = Bench()
    bench.tick(SetZero())
    assert reason(bench.view.zero) == "motor_silent"
    bench.run(0.5)
    bench.lose_to_motor = everything
    bench.run(0.5)
    assert bench.view.phase is MotorPhase.SILENT
    bench.tick(SetZero())
    assert reason(bench.view.zero) == "motor_silent"
    bench.lose_to_motor = nothing
    bench.run(0.5)
    assert not bench.times_of(is_zero)


def test_a_motor_that_is_unsuitable_gets_no_zero() -> None:
    bench = Bench()
    assert bench.gripper.motor.registers.write(10, struct.pack("<I", 2))
    bench.started().tick(SetZero())
    assert reason(bench.view.zero) == "motor_unsuitable"
    bench.run(0.5)
    assert not bench.times_of(is_zero)


def test_jaws_that_move_get_no_zero() -> None:
    bench = Bench().started()
    bench.gripper.push(0.6)
    bench.run(0.05)
    zero = set_zero(bench)
    assert reason(zero) == "not_confirmed"
    assert not zero.is_uncertain
    assert "keep them still" in (zero.failure.message if zero.failure else "")
    assert not bench.times_of(is_zero)


def test_jaws_that_come_to_rest_are_waited_for() -> None:
    bench = Bench().started()
    bench.gripper.push(1.0)
    bench.run(0.1)
    bench.tick(SetZero())
    bench.run(0.2)
    assert not bench.times_of(is_zero)
    bench.gripper.push(0.0)
    zero = ended(bench)
    assert zero.state == "done"
    shift_rad = bench.gripper.position_rad  # counted from the mechanical zero until now
    assert zero.shift_rad == pytest.approx(shift_rad, abs=2 * CODE_RAD)


def test_enabling_waits_until_it_is_over() -> None:
    bench = Bench().started()
    bench.tick(SetZero())
    bench.tick(EnableMotor(3, 0.2))
    view = bench.view
    assert view.phase is MotorPhase.DISABLED
    assert view.failure is not None
    assert view.failure.reason == "busy"
    assert ended(bench).state == "done"
    bench.tick(EnableMotor(3, 0.2))
    bench.run_until(lambda: bench.view.phase is MotorPhase.ENABLED)


@pytest.mark.parametrize("is_sent", [False, True])
def test_disabling_ends_it_at_once(is_sent: bool) -> None:
    bench = Bench().started()
    bench.tick(SetZero())
    if is_sent:
        bench.run_until(lambda: bool(bench.times_of(is_zero)), 0.5)
    bench.tick(DisableMotor())
    assert reason(bench.view.zero) == "not_confirmed"
    assert bench.view.zero.is_uncertain is is_sent
    bench.run(0.5)
    assert bench.view.phase is MotorPhase.DISABLED
    assert len(bench.times_of(is_zero)) == is_sent


def test_a_motor_that_somebody_else_enables_meanwhile_is_disabled_and_gets_no_zero() -> None:
    bench = Bench().started()
    bench.tick(SetZero())
    bench.gripper.receive(bench.now_s, CanFrame(CAN_ID, codec.ENABLE))
    assert reason(ended(bench)) == "not_confirmed"
    bench.run(0.2)
    assert bench.gripper.motor.status == Status.DISABLED
    assert not bench.times_of(is_zero)
