"""When a register is asked for: requests that wait, are withdrawn, or meet a silence."""

import struct

import pytest

from litegripd.model.motor import (
    CanFrame,
    DisableMotor,
    EnableMotor,
    MotorInput,
    MotorPhase,
    RegisterReply,
    RegisterRequest,
)
from litegripd.motor import codec
from litegripd.motor.codec import READ_WITHIN_S
from tests.motor.bench import (
    MASTER_ID,
    PERIOD_S,
    Bench,
    LosesFirst,
    bench_in,
    everything,
    is_answer,
    is_read,
    nothing,
)
from tests.motor.helpers import answer, started

TIMEOUT, PMAX = 9, 21


@pytest.mark.parametrize("phase", [MotorPhase.DISABLED, MotorPhase.ENABLED])
def test_a_motor_that_falls_silent_is_said_to_be_silent(phase: MotorPhase) -> None:
    bench = bench_in(phase)
    bench.lose_to_motor = everything
    asked_s = bench.now_s
    reply = bench.read(RegisterRequest(1, PMAX))
    assert (reply.value, reply.failure and reply.failure.reason) == (None, "motor_silent")
    assert bench.now_s - asked_s <= READ_WITHIN_S + 2 * PERIOD_S
    assert len(bench.times_of(is_read, asked_s + PERIOD_S / 2)) <= 60


def test_while_an_enabled_motor_is_lost_nothing_but_the_status_is_asked_for() -> None:
    bench = Bench().enabled()
    bench.lose_to_motor = everything
    bench.run_until(lambda: bench.view.phase is MotorPhase.SILENT)
    since_s = bench.now_s + PERIOD_S / 2
    bench.register = RegisterRequest(1, PMAX)
    bench.run(0.05)
    assert not bench.times_of(is_read, since_s)
    bench.lose_to_motor = nothing
    bench.run(0.05)
    assert bench.view.phase is MotorPhase.ENABLED
    assert bench.view.register == RegisterReply(1, 12.5)


def test_an_answered_register_is_no_sign_of_life() -> None:
    """Commands that nobody answers are withheld, whatever else is answered."""
    bench = Bench().enabled()
    bench.lose_from_motor = lambda frame: not is_answer(frame)
    for identity in range(12):
        bench.register = RegisterRequest(identity, PMAX)
        bench.tick()
    assert bench.view.phase is MotorPhase.SILENT


def test_reading_does_not_make_old_feedback_look_new() -> None:
    bus = started()
    polled_s = None
    for _ in range(20):
        sent = bus.tick(answers=False)
        if sent:
            polled_s = bus.now_s
            break
    assert polled_s is not None
    assert bus.tick(MotorInput(register=RegisterRequest(1, PMAX)), answers=False)
    bus.motor.receive(bus.now_s, [CanFrame(MASTER_ID, bytes.fromhex("0880007FF8002020"))])
    view = bus.motor.view()
    assert view.feedback is not None
    assert view.feedback.at_s == polled_s


def test_a_reply_stays_and_the_same_request_is_not_read_again() -> None:
    bench = Bench().started()
    request = RegisterRequest(1, PMAX)
    bench.read(request)
    bench.register = request  # as an controller that has not looked yet
    bench.run(PERIOD_S)
    since_s = bench.now_s + PERIOD_S / 2
    bench.run(0.2)
    assert not bench.times_of(is_read, since_s)
    bench.register = None
    bench.run(0.2)
    assert bench.view.register == RegisterReply(1, 12.5)


def test_a_withdrawn_request_is_dropped_and_its_late_answer_ignored() -> None:
    bus = started()
    bus.tick(MotorInput(register=RegisterRequest(1, TIMEOUT)), answers=False)
    for _ in range(10):
        assert not [frame for frame in bus.tick() if is_read(frame)]
    ignored = bus.motor.counters.ignored_frames
    bus.motor.receive(bus.now_s, [answer(TIMEOUT, struct.pack("<I", 2000))])
    assert bus.motor.view().register is None
    assert bus.motor.counters.ignored_frames == ignored + 1


def test_a_request_in_place_of_a_pending_one_is_read_alone() -> None:
    bus = started()
    bus.tick(MotorInput(register=RegisterRequest(1, TIMEOUT)), answers=False)
    sent = bus.tick(MotorInput(register=RegisterRequest(2, PMAX)), answers=False)
    assert [frame.data[3] for frame in sent if is_read(frame)] == [PMAX]
    bus.motor.receive(bus.now_s, [answer(TIMEOUT, struct.pack("<I", 2000))])
    assert bus.motor.view().register is None
    bus.motor.receive(bus.now_s, [answer(PMAX, struct.pack("<f", 12.5))])
    assert bus.motor.view().register == RegisterReply(2, 12.5)


def test_a_request_waits_until_the_motor_has_been_looked_at() -> None:
    bench = Bench()
    reply = bench.read(RegisterRequest(1, PMAX))
    assert reply == RegisterReply(1, 12.5)
    assert bench.view.identity is not None
    numbers = [frame.data[3] for _, frame in bench.sent if is_read(frame)]
    assert numbers.count(PMAX) == 3  # twice in the look, once on demand
    assert numbers[-1] == PMAX


@pytest.mark.parametrize("number", [PMAX, TIMEOUT])
def test_a_request_waits_until_the_motor_is_enabled(number: int) -> None:
    """Enabling reads a register itself; it takes no other's answer, and gives none away."""
    bench = Bench().started()
    bench.register = RegisterRequest(1, number)
    bench.tick(EnableMotor(3, 0.2))
    phases = []
    while bench.view.register is None:
        bench.tick()
        phases.append(bench.view.phase)
        assert len(phases) < 100
    assert phases[-1] is MotorPhase.ENABLED
    assert MotorPhase.ENABLING in phases
    assert set(phases) == {MotorPhase.ENABLING, MotorPhase.ENABLED}
    assert bench.view.register.value == bench.gripper.motor.registers[number]


def test_a_request_outlives_a_disabling() -> None:
    bench = Bench().enabled()
    bench.lose_to_motor = LosesFirst(12, lambda frame: frame.data == codec.DISABLE)
    bench.register = RegisterRequest(1, PMAX)
    bench.tick(DisableMotor())
    phases = []
    while bench.view.register is None:
        bench.tick()
        phases.append(bench.view.phase)
        assert len(phases) < 50
    assert phases.count(MotorPhase.DISABLING) > 10
    assert phases[-1] is MotorPhase.DISABLED
    assert bench.view.register == RegisterReply(1, 12.5)


def test_without_a_motor_a_request_fails_after_a_second() -> None:
    bench = Bench()
    bench.lose_to_motor = everything
    asked_s = bench.now_s
    reply = bench.read(RegisterRequest(1, PMAX))
    assert (reply.value, reply.failure and reply.failure.reason) == (None, "motor_silent")
    assert bench.now_s - asked_s == pytest.approx(READ_WITHIN_S, abs=3 * PERIOD_S)
