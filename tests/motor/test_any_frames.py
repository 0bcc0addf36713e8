"""Whatever comes over the bus, in whatever order things are asked for."""

import struct
from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.gripper import DM4310
from litegripd.model.motor import (
    CanFrame,
    DisableMotor,
    EnableMotor,
    MitCommand,
    MotorInput,
    MotorPhase,
    Ranges,
    RegisterRequest,
    SetZero,
)
from litegripd.motor import codec
from litegripd.motor.motor import Motor
from tests.motor.helpers import MASTER_ID, Registers
from tests.properties import examples
from tests.world import CAN_ID, is_command

COMMAND = MitCommand(-0.1, 0.1, 100.0, 2.0, 0.1)  # every usable range can carry it
UNPOWERED = (MotorPhase.DISABLED, MotorPhase.FAULT, MotorPhase.DISABLING, MotorPhase.UNKNOWN)


@dataclass(frozen=True, slots=True)
class Period:
    """What happens in one period."""

    answers: bool
    request: str | None
    register: int | None
    status: int | None  # the motor changes its status by itself
    extra: tuple[CanFrame, ...]


any_frame = st.builds(
    CanFrame,
    st.sampled_from([0x00, 0x08, 0x18, 0x19, 0x7FF]) | st.integers(0, 0x7FF),
    st.binary(max_size=8),
)
feedback_frame = st.builds(
    lambda status, rest: CanFrame(MASTER_ID, bytes([status << 4 | CAN_ID]) + rest),
    st.sampled_from([0, 0, 1, 1, 8, 13]) | st.integers(0, 15),
    st.binary(min_size=7, max_size=7),
)
answer_frame = st.builds(
    lambda opcode, number, raw: CanFrame(MASTER_ID, bytes([CAN_ID, 0, opcode, number]) + raw),
    st.sampled_from([0x33, 0x55, 0xAA]),
    st.sampled_from([7, 8, 9, 10, 13, 20, 21, 22, 23, 35]) | st.integers(0, 255),
    st.binary(min_size=4, max_size=4) | st.just(struct.pack("<I", MASTER_ID)),
)
periods = st.builds(
    Period,
    st.sampled_from([True, True, True, True, False]),
    st.sampled_from([None, None, None, None, "enable", "disable", "zero", "zero"]),
    st.none() | st.sampled_from([7, 9, 20, 21]) | st.integers(-1, 256),
    st.sampled_from([None, None, None, None, None, None, 0, 1, 8, 13]),
    st.lists(any_frame | feedback_frame | answer_frame, max_size=2).map(tuple) | st.just(()),
)


REQUESTS = {
    "enable": EnableMotor(2, 0.02),
    "disable": DisableMotor(),
    "zero": SetZero(),
    None: None,
}


def input_of(request: str | None, register: int | None = None) -> MotorInput:
    asked = None if register is None else RegisterRequest(register, register)
    return MotorInput(COMMAND, REQUESTS[request], is_motion=True, register=asked)


def is_slack(data: bytes, spans: Ranges) -> bool:
    command = codec.decode_command(data, spans)
    half_nm = spans.torque_nm / 4095 * 1.001
    return command.kp_nm_rad == command.kd_nm_s_rad == 0.0 and abs(command.torque_nm) <= half_nm


@examples(80)
@given(
    st.sampled_from([0, 5, 12, 16]),
    st.sampled_from([0, 1, 8]),
    st.lists(periods, min_size=25, max_size=60),
)
def test_it_never_raises_and_energises_nothing_unasked(
    looked: int, status: int, course: list[Period]
) -> None:
    motor = Motor(CAN_ID)
    bus = Registers(motor)
    bus.status = status
    for _ in range(looked):
        bus.tick()
    asked = stored = False
    for period in course:
        bus.extra = list(period.extra)
        bus.status = bus.status if period.status is None else period.status
        before = motor.view()
        if before.phase in UNPOWERED:
            asked = False
        if period.request == "enable":
            asked = True
        elif period.request == "disable":
            asked = False
        spans = before.identity.ranges if before.identity is not None else DM4310.ranges
        sent = bus.tick(input_of(period.request, period.register), answers=period.answers)
        own = [frame.data for frame in sent if frame.can_id == CAN_ID]
        assert asked or codec.ENABLE not in own
        if codec.SET_ZERO in own:
            assert before.phase is MotorPhase.DISABLED
            assert before.feedback is not None
            assert before.feedback.status == 0
            assert before.zero.state == "pending"
            assert own == [codec.SET_ZERO]
        commands = [frame.data for frame in sent if frame.can_id == CAN_ID and is_command(frame)]
        if before.phase is not MotorPhase.ENABLED:
            assert all(is_slack(data, spans) for data in commands)
            assert asked or len(commands) <= stored
        else:
            disables = own[-1] == codec.DISABLE
            assert len(own) == 1 or (disables and all(is_slack(data, spans) for data in own[:-1]))
            assert len(sent) <= 2
        if commands:  # one more, of zero gains, is due where the motor is off
            stored = not is_slack(commands[-1], spans)
        reply = motor.view().register
        assert reply is None or (reply.value is None) is (reply.failure is not None)
        powered = motor.view().phase in (MotorPhase.ENABLED, MotorPhase.ENABLING)
        if before.phase is MotorPhase.ENABLED and motor.view().phase is not MotorPhase.ENABLED:
            asked = asked and motor.view().phase is MotorPhase.SILENT
        assert asked or not powered


@examples(30)
@given(st.lists(periods, min_size=15, max_size=40))
def test_it_always_finds_back_to_disabled(course: list[Period]) -> None:
    motor = Motor(CAN_ID)
    bus = Registers(motor)
    for period in course:
        bus.extra = list(period.extra)
        bus.status = bus.status if period.status is None else period.status
        bus.tick(input_of(period.request), answers=period.answers)
    bus.extra = []
    bus.status = 0
    bus.tick(input_of("disable"))
    for _ in range(300):
        bus.tick()
    assert motor.view().phase is MotorPhase.DISABLED
    bus.tick(input_of("enable"))
    for _ in range(20):
        bus.tick(MotorInput(COMMAND))
    view = motor.view()
    assert view.phase is MotorPhase.ENABLED or view.problem is not None
