"""Reading a register on demand: in every phase that answers, and never instead of anything else."""

import math
import random
import struct
from itertools import pairwise

import pytest

from litegripd.model.motor import (
    CanFrame,
    DisableMotor,
    EnableMotor,
    MitCommand,
    MotorInput,
    MotorPhase,
    RegisterReply,
    RegisterRequest,
)
from litegripd.motor import codec
from litegripd.motor.codec import (
    READ_TRIES,
    READ_WITHIN_S,
    REGISTERS,
    Answer,
    RegisterReader,
)
from litegripd.motor.phases import Phase
from tests.motor.bench import (
    CAN_ID,
    MASTER_ID,
    PERIOD_S,
    REGISTER_ID,
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


def is_command(frame: CanFrame) -> bool:
    return frame.can_id == CAN_ID


def failure_of(reply: RegisterReply) -> str:
    assert reply.value is None
    assert reply.failure is not None
    return reply.failure.reason


@pytest.mark.parametrize("phase", [MotorPhase.DISABLED, MotorPhase.ENABLED, MotorPhase.FAULT])
def test_every_register_is_read_at_once_wherever_the_motor_answers(phase: MotorPhase) -> None:
    bench = bench_in(phase)
    held = bench.gripper.motor.registers
    for identity, (number, register) in enumerate(REGISTERS.items()):
        asked_s = bench.now_s
        reply = bench.read(RegisterRequest(identity, number))
        assert reply == RegisterReply(identity, reply.value)
        assert reply.value == pytest.approx(held[number])
        assert isinstance(reply.value, float if register.kind == "f" else int)
        assert bench.now_s - asked_s <= 2.5 * PERIOD_S
        assert bench.view.phase is phase


def test_reading_while_enabled_never_costs_a_command() -> None:
    bench = Bench().enabled()
    since_s = bench.now_s + PERIOD_S / 2
    for tick in range(1000):
        if tick % 3 == 0:
            bench.register = RegisterRequest(tick, list(REGISTERS)[tick % len(REGISTERS)])
        first, *rest = bench.tick()
        assert is_command(first)
        assert first.data[:7] != b"\xff" * 7
        assert all(is_read(frame) for frame in rest)
        assert len(rest) <= 1
    assert len(bench.times_of(is_command, since_s)) == 1000
    assert len(bench.times_of(is_read, since_s)) == 334
    assert bench.motor.counters.missed_replies == 0
    assert bench.view.phase is MotorPhase.ENABLED


def test_reading_while_enabled_changes_no_measured_value() -> None:
    """A register's answer would decode to a position of about -12.47 rad."""
    bench = Bench().enabled()
    true_rad = bench.gripper.position_rad
    for tick in range(300):
        bench.register = RegisterRequest(tick // 4, TIMEOUT)
        bench.tick()
        assert bench.feedback.position_rad == pytest.approx(true_rad, abs=1e-3)
    assert bench.view.register == RegisterReply(74, 2000)


@pytest.mark.parametrize("first", ["answer", "feedback"])
def test_an_answer_and_feedback_in_one_tick_are_told_apart(first: str) -> None:
    bus = started()
    request = RegisterRequest(5, TIMEOUT)
    bus.tick(MotorInput(register=request), answers=False)
    feedback = CanFrame(MASTER_ID, bytes.fromhex("08 9000 7FF800 2020"))
    frames = [answer(TIMEOUT, struct.pack("<I", 2000)), feedback]
    bus.motor.receive(bus.now_s, frames if first == "answer" else frames[::-1])
    view = bus.motor.view()
    assert view.register == RegisterReply(5, 2000)
    assert view.feedback is not None
    assert view.feedback.position_rad == pytest.approx(12.5 * (2 * 0x9000 / 0xFFFF - 1))


@pytest.mark.parametrize("lost", range(READ_TRIES))
@pytest.mark.parametrize("way", ["to", "from"])
def test_a_lost_frame_is_asked_for_again_after_20_ms(lost: int, way: str) -> None:
    bench = Bench().started()
    loses = LosesFirst(lost, is_read if way == "to" else is_answer)
    if way == "to":
        bench.lose_to_motor = loses
    else:
        bench.lose_from_motor = loses
    since_s = bench.now_s + PERIOD_S / 2
    assert bench.read(RegisterRequest(1, PMAX)) == RegisterReply(1, 12.5)
    times = bench.times_of(is_read, since_s)
    assert len(times) == lost + 1
    for earlier, later in pairwise(times):
        assert later - earlier == pytest.approx(0.02, abs=PERIOD_S + 1e-6)


def test_a_register_that_is_never_answered_fails_after_five_tries() -> None:
    bench = Bench().started()
    bench.lose_from_motor = is_answer
    since_s = bench.now_s + PERIOD_S / 2
    reply = bench.read(RegisterRequest(1, PMAX))
    assert failure_of(reply) == "motor_silent"
    assert len(bench.times_of(is_read, since_s)) == READ_TRIES == 5
    assert bench.now_s - since_s < 0.15
    assert bench.view.phase is MotorPhase.DISABLED
    bench.lose_from_motor = nothing
    assert bench.read(RegisterRequest(2, PMAX)).value == 12.5


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_no_number_is_a_failure(bad: float) -> None:
    bus = started(r20=struct.pack("<f", bad))
    for _ in range(3):
        bus.tick(MotorInput(register=RegisterRequest(3, 20)))
    reply = bus.motor.view().register
    assert reply is not None
    assert reply.failure is not None
    assert (reply.identity, reply.value, reply.failure.reason) == (3, None, "motor_unsuitable")
    assert "Gr" in reply.failure.message


@pytest.mark.parametrize("number", [-1, 37, 57, 82, 255, 256])
def test_a_number_that_the_table_does_not_have_is_refused_and_not_sent(number: int) -> None:
    bench = Bench().started()
    since_s = bench.now_s + PERIOD_S / 2
    reply = bench.read(RegisterRequest(8, number))
    assert failure_of(reply) == "invalid_params"
    assert not bench.times_of(is_read, since_s)


@pytest.mark.parametrize(
    "frame",
    [
        answer(PMAX, struct.pack("<f", 3.0)),  # another register
        answer(TIMEOUT, struct.pack("<I", 7), opcode=0x55),  # to a write
        answer(TIMEOUT, struct.pack("<I", 7), opcode=0xAA),
        answer(TIMEOUT, struct.pack("<I", 7), can_id=0x19),  # another motor's id
        answer(TIMEOUT, bytes(4), can_id=REGISTER_ID),  # another process's request
        CanFrame(MASTER_ID, bytes([9, 0, 0x33, TIMEOUT, 7, 0, 0, 0])),  # another motor's answer
        CanFrame(MASTER_ID, bytes([CAN_ID, 0, 0x33, TIMEOUT, 7])),  # cut off
    ],
)
def test_what_is_not_the_awaited_answer_is_neither_value_nor_feedback(frame: CanFrame) -> None:
    bus = started()
    wanted = MotorInput(register=RegisterRequest(1, TIMEOUT))
    bus.tick(wanted, answers=False)
    before = bus.motor.view().feedback
    counters = bus.motor.counters
    counted = counters.ignored_frames + counters.foreign_commands
    bus.motor.receive(bus.now_s, [frame])
    assert bus.motor.view().register is None
    assert bus.motor.view().feedback == before
    assert counters.ignored_frames + counters.foreign_commands == counted + 1
    bus.motor.receive(bus.now_s, [answer(TIMEOUT, struct.pack("<I", 2000))])
    assert bus.motor.view().register == RegisterReply(1, 2000)


def test_an_answer_that_came_twice_counts_once() -> None:
    bus = started()
    bus.tick(MotorInput(register=RegisterRequest(1, TIMEOUT)))
    ignored = bus.motor.counters.ignored_frames
    bus.motor.receive(bus.now_s, [answer(TIMEOUT, struct.pack("<I", 7))])
    assert bus.motor.view().register == RegisterReply(1, 2000)
    assert bus.motor.counters.ignored_frames == ignored + 1


def test_an_answer_before_the_request_was_sent_does_not_count() -> None:
    reading, request = RegisterReader(CAN_ID), RegisterRequest(1, TIMEOUT)
    early = Answer(TIMEOUT, False, struct.pack("<I", 7))
    assert not reading.take(early)
    assert reading.step(0.0, request, Phase.PREPARING) == []
    assert not reading.take(early)
    assert len(reading.step(0.005, request, Phase.ENABLED)) == 1
    assert reading.take(early)


def test_a_lossy_bus_gives_a_true_value_or_none() -> None:
    bench, chance = Bench().enabled(), random.Random(1)
    bench.lose_to_motor = bench.lose_from_motor = lambda _frame: chance.random() < 0.3
    values = []
    for identity in range(40):
        reply = bench.read(RegisterRequest(identity, TIMEOUT))
        assert (reply.value is None) is (reply.failure is not None)
        values.append(reply.value)
        assert abs(bench.feedback.position_rad) < 2.0
    assert set(values) - {None} == {2000}
    assert values.count(2000) > 30


def test_a_command_goes_out_though_its_register_request_is_impossible() -> None:
    bus = started()
    bus.tick(MotorInput(request=EnableMotor(3, 0.2)))
    for _ in range(20):
        bus.tick(MotorInput(MitCommand(0.0, 0.0, 0.0, 1.0, 0.0)))
    assert bus.motor.view().phase is MotorPhase.ENABLED
    wanted = MotorInput(MitCommand(0.0, 0.0, 0.0, 1.0, 0.0), register=RegisterRequest(1, 999))
    assert [frame.can_id for frame in bus.tick(wanted)] == [CAN_ID]


# When it is asked for: requests that wait, are withdrawn, or meet a silence


@pytest.mark.parametrize("phase", [MotorPhase.DISABLED, MotorPhase.ENABLED])
def test_a_motor_that_falls_silent_is_said_to_be_silent(phase: MotorPhase) -> None:
    bench = bench_in(phase)
    bench.lose_to_motor = everything
    asked_s = bench.now_s
    reply = bench.read(RegisterRequest(1, PMAX))
    assert failure_of(reply) == "motor_silent"
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
    assert failure_of(reply) == "motor_silent"
    assert bench.now_s - asked_s == pytest.approx(READ_WITHIN_S, abs=3 * PERIOD_S)
