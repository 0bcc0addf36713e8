"""Reading what the motor reports about itself, and rejecting what does not fit."""

import random
import struct

import pytest

from litegripd.model.gripper import DM4310
from litegripd.model.motor import (
    CanFrame,
    EnableMotor,
    MotorIdentity,
    MotorInput,
    MotorPhase,
    Ranges,
)
from litegripd.motor import codec as reg
from litegripd.motor.identity import LONGEST_WATCHDOG_S, RegisterScan, unsuitable, warnings
from litegripd.motor.motor import Motor
from litegripd.sim.plant import SimulatorParameters
from tests.motor.helpers import MASTER_ID, Registers, replace_answers, world_with
from tests.world import CAN_ID, World


def test_the_first_frames_only_read() -> None:
    world = World()
    world.run(2.0)
    assert world.phase is MotorPhase.DISABLED
    assert {sent.frame.can_id for sent in world.sent} == {0x7FF}
    assert {sent.frame.data[2] for sent in world.sent} == {0x33, 0xCC}


@pytest.mark.parametrize("master_id", [0x00, 0x18, 0x11, 0x7FE])
def test_the_master_id_is_found(master_id: int) -> None:
    world = World(parameters=SimulatorParameters(master_id=master_id)).start()
    assert world.identity.master_id == master_id
    assert world.client().result("motor.enable")["ok"]


def test_a_configured_master_id_that_differs_is_refused_with_the_reason() -> None:
    world = World(parameters=SimulatorParameters(master_id=0x11), master_id=0x18).start()
    world.client().refused("motor.enable", "motor_unsuitable", "0x11", "0x18")
    world.run(0.5)
    assert not [sent for sent in world.sent if sent.frame.can_id == CAN_ID]


def test_a_configured_master_id_that_is_right_is_accepted() -> None:
    world = World(parameters=SimulatorParameters(master_id=0x11), master_id=0x11)
    assert world.enabled()


def test_the_motors_own_ranges_are_used() -> None:
    world = world_with(21, struct.pack("<f", 3.14))
    client = world.enabled()
    assert world.identity.ranges.position_rad == pytest.approx(3.14)
    assert world.state.position_rad == pytest.approx(world.gripper.position_rad, abs=1e-3)
    assert client.result("motion.open")["ok"]
    assert client.result("motion.close")["ok"]
    assert any("3.14" in text for text in warnings(world.identity))


def test_no_position_is_shown_before_its_range_is_known() -> None:
    world = world_with(21, struct.pack("<f", 3.14))
    true_rad = world.gripper.position_rad
    seen = []
    for _ in range(100):
        world.tick()
        seen.append(world.state.position_rad)
    known = [position for position in seen if position is not None]
    assert known
    assert known == pytest.approx([true_rad] * len(known), abs=1e-3)


@pytest.mark.parametrize("mode", [2, 3, 4])
def test_another_control_mode_than_mit_is_refused(mode: int) -> None:
    world = world_with(10, struct.pack("<I", mode)).start()
    world.client().refused("motor.enable", "motor_unsuitable", "CTRL_MODE")
    assert not [sent for sent in world.sent if sent.frame.can_id == CAN_ID]


def identity_with(**changes: object) -> MotorIdentity:
    values: dict[str, object] = {
        "can_id": 8,
        "master_id": 0x18,
        "ranges": DM4310.ranges,
        "timeout_s": 0.1,
        "control_mode": 1,
    }
    return MotorIdentity(**(values | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [0.0, -1.0, 1e-30, float("nan"), float("inf"), 1e30])
@pytest.mark.parametrize("which", range(3))
def test_absurd_ranges_are_unsuitable(bad: float, which: int) -> None:
    values = [12.5, 30.0, 10.0]
    values[which] = bad
    refusal = unsuitable(identity_with(ranges=Ranges(*values)), None)
    assert refusal is not None
    assert refusal.reason == "motor_unsuitable"


def test_a_usual_motor_is_suitable_and_warns_of_nothing() -> None:
    assert unsuitable(identity_with(), None) is None
    assert unsuitable(identity_with(), 0x18) is None
    assert warnings(identity_with()) == []
    assert warnings(identity_with(timeout_s=0.0))
    assert warnings(identity_with(timeout_s=2 * LONGEST_WATCHDOG_S))


@pytest.mark.parametrize("bad", [0.0, float("nan"), float("inf")])
def test_a_motor_with_absurd_ranges_shows_no_position_and_is_not_enabled(bad: float) -> None:
    """A range of NaN would make every position NaN."""
    motor = Motor(8)
    bus = Registers(motor, r21=struct.pack("<f", bad))
    for _ in range(100):
        bus.tick()
    view = motor.view()
    assert view.identity is not None
    assert view.feedback is None
    assert view.problem is not None
    assert view.problem.reason == "motor_unsuitable"
    frames = motor.step(1.0, MotorInput(request=EnableMotor(3, 0.2)))
    assert not [frame for frame in frames if frame.can_id == 8]
    assert motor.view().failure == view.problem


def test_registers_that_only_inform_may_stay_unanswered() -> None:
    motor = Motor(8)
    bus = Registers(motor)
    for number in (8, 13, 14, 15, 20, 35):
        del bus.values[number]
    for _ in range(150):
        bus.tick()
    view = motor.view()
    assert view.phase is MotorPhase.DISABLED
    assert view.identity is not None
    assert view.identity.registers["SN"] is None


@pytest.mark.parametrize("number", [7, 9, 10, 21, 22, 23])
def test_an_essential_register_is_asked_for_until_it_is_answered(number: int) -> None:
    motor = Motor(8)
    bus = Registers(motor)
    missing = bus.values.pop(number)
    for _ in range(150):
        bus.tick()
    view = motor.view()
    assert view.identity is None
    assert view.phase in (MotorPhase.UNKNOWN, MotorPhase.SILENT)
    bus.values[number] = missing
    for _ in range(50):
        bus.tick()
    assert motor.view().phase is MotorPhase.DISABLED


def test_late_and_wrong_answers_are_not_taken_for_the_awaited_one() -> None:
    look = RegisterScan(8)
    look.step(0.0)
    wrong = reg.Answer(9, False, struct.pack("<I", 2000))
    assert not look.take(wrong, MASTER_ID)
    assert not look.take(reg.Answer(7, True, struct.pack("<I", 0x18)), MASTER_ID)
    assert not look.take(reg.Answer(7, False, struct.pack("<I", 0x19)), MASTER_ID)
    right = reg.Answer(7, False, struct.pack("<I", 0x18))
    assert look.take(right, MASTER_ID)
    assert not look.take(right, MASTER_ID)  # doubled on the bus
    assert look.master_id is None
    assert look.step(0.005)
    assert look.take(right, MASTER_ID)
    assert not look.take(right, MASTER_ID)
    assert look.master_id == 0x18


def disturbed_once(world: World, number: int, raw: bytes) -> None:
    """Let the motor's next answer for a register come with another value."""

    def other(frame: CanFrame) -> CanFrame | None:
        is_it = frame.data[2] == 0x33 and frame.data[3] == number
        return CanFrame(frame.can_id, frame.data[:4] + raw) if is_it else None

    replace_answers(world, other, 1)


@pytest.mark.parametrize(
    ("number", "raw"),
    [
        (10, struct.pack("<I", 24577)),
        (21, struct.pack("<f", 15.5)),
        (23, struct.pack("<f", -1e-14)),
        (9, struct.pack("<I", 0)),
    ],
)
def test_one_disturbed_answer_is_not_believed(number: int, raw: bytes) -> None:
    world = World()
    disturbed_once(world, number, raw)
    assert world.start().client().result("motor.enable")["ok"]
    assert world.identity.ranges == DM4310.ranges
    assert world.identity.control_mode == 1
    assert world.identity.timeout_s == pytest.approx(0.1)


def test_a_motor_whose_registers_were_set_meanwhile_is_usable_after_clear_fault() -> None:
    world = world_with(10, struct.pack("<I", 2)).start()
    client = world.client()
    assert client.refusal("motor.enable") == "motor_unsuitable"
    assert client.refusal("motor.clear_fault") == "motor_unsuitable"
    world.gripper.motor.registers.write(10, struct.pack("<I", 1))
    assert client.refusal("motor.enable") == "motor_unsuitable"  # nobody has looked
    assert client.result("motor.clear_fault")["cleared"] == "motor_unsuitable"
    assert client.result("motor.enable")["ok"]


def test_another_process_that_reads_registers_gives_no_answers() -> None:
    """Its request has an answer's shape, with a value of zero, on 0x7FF."""
    motor = Motor(8)
    bus = Registers(motor)
    bus.extra = [reg.read_request(8, register) for register in reg.READ_AT_START]
    for _ in range(100):
        bus.tick()
    identity = motor.view().identity
    assert identity is not None
    assert identity.ranges == DM4310.ranges
    assert identity.timeout_s == pytest.approx(0.1)
    assert identity.control_mode == 1


def test_registers_are_not_asked_for_again_while_an_answer_may_be_under_way() -> None:
    look = RegisterScan(8)
    assert look.step(0.0)
    assert not look.step(0.005)
    assert not look.step(0.015)
    assert look.step(0.021)


def test_one_clear_fault_sees_to_a_fault_and_to_registers_that_were_set_meanwhile() -> None:
    world = world_with(10, struct.pack("<I", 2)).start()
    client = world.client()
    world.gripper.latch_fault(0xE)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    world.gripper.motor.registers.write(10, struct.pack("<I", 1))
    assert client.result("motor.clear_fault")["cleared"] == "overload"
    assert client.result("motor.enable")["ok"]


def test_registers_are_read_again_though_half_of_the_answers_are_lost() -> None:
    world = world_with(10, struct.pack("<I", 2)).start()
    world.gripper.motor.registers.write(10, struct.pack("<I", 1))
    chance = random.Random(1)
    for _ in range(8):
        world.lose_from_motor = lambda _frame: chance.random() < 0.5
        assert world.client().result("motor.clear_fault")["ok"]
        world.lose_from_motor = lambda _frame: False
        world.gripper.motor.registers.write(10, struct.pack("<I", 2))
        world.gripper.power_cycle()
        world.run(1.0)
        world.gripper.motor.registers.write(10, struct.pack("<I", 1))
