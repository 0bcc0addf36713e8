"""Setting the motor's zero: only while it is disabled, with the jaws at rest, and confirmed."""

import random
import struct
from collections.abc import Callable
from itertools import pairwise

import pytest

from litegripd.model.motor import (
    CanFrame,
    DisableMotor,
    EnableMotor,
    MotorPhase,
    RegisterReply,
    RegisterRequest,
    SetZero,
    Status,
    ZeroView,
)
from litegripd.motor import codec
from litegripd.motor.procedures import ZERO_RETRY_S, ZERO_TRIES, ZERO_WITHIN_RAD
from tests.motor.bench import (
    CAN_ID,
    MASTER_ID,
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


def until_sent(bench: Bench) -> None:
    """Ask for the zero, and let time pass until its first frame has been sent."""
    bench.tick(SetZero())
    bench.run_until(lambda: bool(bench.times_of(is_zero)), 0.5)


def test_the_motor_counts_from_where_the_jaws_are() -> None:
    bench = Bench().started()
    assert bench.view.zero == ZeroView("idle")
    before_rad, since_s = bench.feedback.position_rad, bench.now_s
    assert abs(before_rad) > 0.1
    zero = set_zero(bench)
    assert zero == ZeroView("done", zero.shift_rad, zero.position_rad)
    assert zero.shift_rad == pytest.approx(before_rad, abs=2 * CODE_RAD)
    assert zero.position_rad == bench.feedback.position_rad == pytest.approx(0.0, abs=CODE_RAD)
    assert bench.gripper.motor.reported_position_rad == pytest.approx(0.0, abs=1e-9)
    assert bench.now_s - since_s < 0.15
    own = [frame for _, frame in bench.sent if frame.can_id == CAN_ID]
    assert [is_zero(frame) for frame in own] == [True]
    bench.run(1.0)
    assert bench.view.zero == zero
    assert len(bench.times_of(is_zero)) == 1
    assert bench.view.phase is MotorPhase.DISABLED


def test_it_is_pending_from_the_next_tick_on_and_uncertain_once_it_was_sent() -> None:
    bench = Bench().started()
    bench.tick(SetZero())
    assert bench.view.zero == ZeroView("pending")
    bench.run_until(lambda: bool(bench.times_of(is_zero)), 0.5)
    assert bench.view.zero == ZeroView("pending", is_uncertain=True)


def test_the_next_one_shifts_by_what_the_jaws_were_moved() -> None:
    bench = Bench().started()
    first = set_zero(bench)
    bench.gripper.push(1.0)
    bench.run(0.2)
    bench.gripper.push(0.0)
    bench.run(0.2)
    assert bench.view.zero == first
    moved_rad = bench.feedback.position_rad
    assert moved_rad > 0.1
    assert set_zero(bench).shift_rad == pytest.approx(moved_rad, abs=2 * CODE_RAD)
    assert set_zero(bench).shift_rad == pytest.approx(0.0, abs=2 * CODE_RAD)


def test_enabling_after_it_does_not_move_the_jaws() -> None:
    bench = Bench().started()
    set_zero(bench)
    mechanical_rad = bench.gripper.position_rad
    bench.tick(EnableMotor(3, 0.2))
    bench.run_until(lambda: bench.view.phase is MotorPhase.ENABLED)
    bench.run(0.2)
    assert bench.gripper.position_rad == pytest.approx(mechanical_rad, abs=0.002)
    assert bench.feedback.position_rad == pytest.approx(0.0, abs=0.002)


@pytest.mark.parametrize("lost", range(1, ZERO_TRIES))
def test_a_lost_frame_is_seen_by_the_position_and_sent_again(lost: int) -> None:
    bench = Bench().started()
    bench.lose_to_motor = LosesFirst(lost, is_zero)
    before_rad = bench.feedback.position_rad
    zero = set_zero(bench)
    assert zero.state == "done"
    assert zero.shift_rad == pytest.approx(before_rad, abs=2 * CODE_RAD)
    times = bench.times_of(is_zero)
    assert len(times) == lost + 1
    assert all(
        ZERO_RETRY_S - 1e-6 < b - a < ZERO_RETRY_S + 2 * PERIOD_S for a, b in pairwise(times)
    )


def test_a_motor_that_never_takes_it_has_certainly_kept_its_zero() -> None:
    bench = Bench().started()
    bench.lose_to_motor = is_zero
    before_rad = bench.feedback.position_rad
    zero = set_zero(bench)
    assert (reason(zero), zero.is_uncertain) == ("not_confirmed", False)
    assert len(bench.times_of(is_zero)) == ZERO_TRIES
    assert bench.feedback.position_rad == pytest.approx(before_rad, abs=CODE_RAD)
    bench.lose_to_motor = nothing
    assert set_zero(bench).state == "done"


def test_without_an_answer_afterwards_nobody_knows_and_nothing_is_repeated() -> None:
    bench = Bench().started()
    until_sent(bench)
    bench.lose_from_motor = everything
    bench.lose_in_flight()
    zero = ended(bench)
    assert (reason(zero), zero.is_uncertain) == ("not_confirmed", True)
    assert zero.failure is not None
    assert "does not answer" in zero.failure.message
    assert len(bench.times_of(is_zero)) == 1


def test_jaws_that_are_moved_before_it_is_confirmed_leave_it_uncertain() -> None:
    """By how much the positions are shifted is then unknown, so it must not be said."""
    bench = Bench().started()
    until_sent(bench)
    bench.lose_from_motor = everything
    bench.lose_in_flight()
    bench.gripper.push(1.5)
    bench.run(0.08)
    bench.lose_from_motor = nothing
    zero = ended(bench)
    assert (reason(zero), zero.is_uncertain) == ("not_confirmed", True)
    assert "moved" in (zero.failure.message if zero.failure else "")
    assert len(bench.times_of(is_zero)) == 1


def test_an_answer_from_before_the_frame_does_not_confirm_it() -> None:
    """It may have been under way. Here it reports a zero that the motor never took."""
    bench = Bench().started()
    bench.lose_to_motor = LosesFirst(1, is_zero)
    until_sent(bench)
    bench.lose_in_flight()
    bench.inject(feedback_frame(0.0))
    assert bench.receive().zero.state == "pending"
    bench.step()
    assert ended(bench).state == "done"
    assert len(bench.times_of(is_zero)) == 2


@pytest.mark.parametrize(
    "frame",
    [
        feedback_frame(0.0, motor=9),
        CanFrame(0x19, feedback_frame(0.0).data),
        CanFrame(0x00, feedback_frame(0.0).data),
        CanFrame(MASTER_ID, feedback_frame(0.0).data[:7]),
        CanFrame(MASTER_ID, bytes([CAN_ID, 0, 0x55, 9, 0x80, 0, 0, 0])),
    ],
)
def test_what_other_motors_answer_confirms_nothing(frame: CanFrame) -> None:
    bench = Bench().started()
    bench.lose_to_motor = is_zero
    bench.tick(SetZero())
    while bench.view.zero.state == "pending":
        bench.inject(frame)
        bench.tick()
    assert reason(bench.view.zero) == "not_confirmed"
    assert len(bench.times_of(is_zero)) == ZERO_TRIES


def test_answers_of_registers_are_not_taken_for_positions_meanwhile() -> None:
    """They decode to -12.47 rad, on the same id and while positions are awaited."""
    bench = Bench().started()
    before_rad = bench.feedback.position_rad
    bench.tick(SetZero())
    identity = 0
    while bench.view.zero.state == "pending":
        identity += 1
        bench.register = RegisterRequest(identity // 3, 9)
        bench.inject(CanFrame(MASTER_ID, bytes.fromhex("08003315000048 41")))
        bench.tick()
    assert bench.view.zero.state == "done"
    assert bench.view.zero.shift_rad == pytest.approx(before_rad, abs=2 * CODE_RAD)
    assert bench.view.register == RegisterReply((identity - 1) // 3, 2000)


def test_the_frame_goes_before_everything_else_in_its_tick() -> None:
    bench = Bench().started()
    bench.register = RegisterRequest(1, 9)
    until_sent(bench)
    at_s = bench.times_of(is_zero)[0]
    assert is_zero(next(frame for sent_s, frame in bench.sent if sent_s == at_s))


def test_asking_twice_does_it_once() -> None:
    bench = Bench().started()
    before_rad, since_s = bench.feedback.position_rad, bench.now_s
    bench.tick(SetZero())
    while bench.receive().zero.state == "pending":
        bench.step(SetZero())
    assert bench.now_s - since_s < 0.15
    assert len(bench.times_of(is_zero)) == 1
    assert bench.view.zero.shift_rad == pytest.approx(before_rad, abs=2 * CODE_RAD)


@pytest.mark.parametrize("seed", range(25))
def test_a_lossy_bus_never_makes_it_untrue(seed: int) -> None:
    chance = random.Random(seed)
    bench = Bench(seed=seed).started()
    mechanical_rad = bench.gripper.position_rad
    bench.lose_to_motor = bench.lose_from_motor = lambda _frame: chance.random() < 0.45
    zero = set_zero(bench)
    reported_rad = bench.gripper.motor.reported_position_rad
    if zero.state == "done":
        assert abs(reported_rad) < ZERO_WITHIN_RAD
        assert zero.shift_rad == pytest.approx(mechanical_rad - reported_rad, abs=4 * CODE_RAD)
    elif not zero.is_uncertain:
        assert reported_rad == pytest.approx(mechanical_rad, abs=1e-6)
    assert len(bench.times_of(is_zero)) <= ZERO_TRIES


def test_most_succeed_on_a_lossy_bus() -> None:
    chance, done = random.Random(2), 0
    for seed in range(25):
        bench = Bench(seed=seed).started()
        bench.lose_to_motor = bench.lose_from_motor = lambda _frame: chance.random() < 0.2
        done += set_zero(bench).state == "done"
    assert done >= 24


@pytest.mark.parametrize("range_rad", [3.14, 12.5, 200.0, 900.0])
def test_it_is_confirmed_in_any_range_and_with_noise(range_rad: float) -> None:
    bench = Bench(seed=3)
    assert bench.gripper.motor.registers.write(21, struct.pack("<f", range_rad))
    bench.gripper.motor.registers.save()
    bench.gripper.power_cycle()
    before_rad = bench.gripper.motor.reported_position_rad
    zero = set_zero(bench.started())
    assert zero.state == "done"
    assert zero.shift_rad == pytest.approx(before_rad, abs=3 * 2 * range_rad / 65535)


@pytest.mark.parametrize("near_rad", [0.0, 0.008, -0.008])
def test_a_lost_frame_near_the_old_zero_does_no_harm(near_rad: float) -> None:
    """It looks like a taken one, but what is said of the positions is true."""
    bench = Bench().started()
    set_zero(bench)
    bench.gripper.motor._offset_rad += near_rad
    bench.run(0.1)
    bench.lose_to_motor = LosesFirst(1, is_zero)
    zero = set_zero(bench)
    assert zero.state == "done"
    assert zero.position_rad == pytest.approx(near_rad, abs=2 * CODE_RAD)
    assert zero.shift_rad == pytest.approx(0.0, abs=2 * CODE_RAD)


# When none is set: the motor does not say that it is disabled, or the jaws move


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


def being_enabled() -> Bench:
    bench = Bench().started()
    bench.tick(EnableMotor(3, 0.2))
    return bench


def being_disabled() -> Bench:
    bench = Bench().enabled()
    bench.lose_to_motor = LosesFirst(5, lambda frame: frame.data == codec.DISABLE)
    bench.tick(DisableMotor())
    return bench


def silent() -> Bench:
    bench = Bench().started()
    bench.lose_to_motor = everything
    bench.run(0.5)
    return bench


def unsuitable() -> Bench:
    bench = Bench()
    assert bench.gripper.motor.registers.write(10, struct.pack("<I", 2))
    return bench.started()


@pytest.mark.parametrize(
    ("made", "phase", "why"),
    [
        (Bench, MotorPhase.UNKNOWN, "motor_silent"),
        (silent, MotorPhase.SILENT, "motor_silent"),
        (unsuitable, MotorPhase.DISABLED, "motor_unsuitable"),
        (being_enabled, MotorPhase.ENABLING, "not_confirmed"),
        (being_disabled, MotorPhase.DISABLING, "not_confirmed"),
        (lambda: Bench().faulty(), MotorPhase.FAULT, "motor_fault"),
    ],
)
def test_it_is_refused_unless_the_motor_is_known_to_be_off(
    made: Callable[[], Bench], phase: MotorPhase, why: str
) -> None:
    bench = made()
    bench.tick(SetZero())
    assert (bench.view.phase, reason(bench.view.zero)) == (phase, why)
    bench.lose_to_motor = nothing
    bench.run(0.5)
    assert not bench.times_of(is_zero)


def test_jaws_that_move_get_no_zero() -> None:
    bench = Bench().started()
    bench.gripper.push(0.6)
    bench.run(0.05)
    zero = set_zero(bench)
    assert (reason(zero), zero.is_uncertain) == ("not_confirmed", False)
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
