"""Another program, or a power cycle, changes the registers that decide what every frame means."""

import struct
from dataclasses import dataclass
from typing import Any

import pytest

from litegripd.model.motor import CanFrame, MotorPhase, Status
from litegripd.motor.codec import (
    CONTROL_MODE,
    MASTER_ID,
    PMAX,
    REGISTER_CAN_ID,
    TIMEOUT,
    TMAX,
    VMAX,
    Register,
    read_request,
    write_request,
)
from tests.motor.bench import LosesFirst
from tests.motor.helpers import gripping as gripped
from tests.world import CAN_ID, PERIOD_S, Client, World, enabled_world, found_world, reason_of

FORCE_NM = 1.0
WRITES: list[tuple[Register, float]] = [
    (TMAX, 54.0),
    (TMAX, 5.0),
    (PMAX, 25.0),
    (PMAX, 6.0),
    (VMAX, 50.0),
    (TIMEOUT, 0),
    (CONTROL_MODE, 2),
    (MASTER_ID, 0x19),
]
SCALES = [write for write in WRITES if write[0] in (TMAX, PMAX, VMAX)]
HEARD = ["both", "request", "answer"]


def write(world: World, register: Register, value: float, heard: str = "both") -> None:
    """Let another node write a register; we hear its request, the motor's answer, or both."""
    request = write_request(CAN_ID, register, value)
    answers = world.gripper.receive(world.now_s + 2e-4, request)
    assert len(answers) == 1
    if heard in ("both", "request"):
        world.inject(request)
    if heard in ("both", "answer"):
        world.inject(answers[0])


def watched(world: World) -> Client:
    client = world.client()
    client.result("events.subscribe")
    return client


def events(client: Client, kind: str) -> list[dict[str, Any]]:
    return [event for event in client.told("event") if event["kind"] == kind]


def gripping() -> tuple[World, Client]:
    world, _ = gripped()
    return world, watched(world)


@dataclass
class Course:
    """What a scene has seen of the true torque and the true opening."""

    torques_nm: list[float]
    openings_mm: list[float]


def observe(world: World, duration_s: float) -> Course:
    """Let time pass; note what is true every millisecond."""
    course = Course([], [])
    for _ in range(round(duration_s / PERIOD_S)):
        world.tick()
        for step in range(1, 5):
            world.gripper.advance(world.now_s + step * 1e-3)
            course.torques_nm.append(abs(world.gripper.motor_torque_nm))
            course.openings_mm.append(world.gripper.opening_mm)
    return course


@pytest.mark.parametrize("heard", HEARD)
@pytest.mark.parametrize(("register", "value"), SCALES)
def test_a_scale_that_changes_while_something_is_held_neither_crushes_nor_drops_it(
    register: Register, value: float, heard: str
) -> None:
    world, _ = gripping()
    before_mm, state_rad = world.gripper.opening_mm, world.state.position_rad
    write(world, register, value, heard)
    course = observe(world, 0.5)
    too_much = [nm for nm in course.torques_nm if nm > 1.3 * FORCE_NM]
    assert len(too_much) <= 5  # milliseconds, one period
    assert course.torques_nm[-1] == pytest.approx(FORCE_NM, abs=0.15)
    assert max(abs(mm - before_mm) for mm in course.openings_mm) < 0.5
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.state.is_grasped
    assert world.state.torque_nm == pytest.approx(world.gripper.motor_torque_nm, abs=0.1)
    assert world.state.position_rad == pytest.approx(state_rad, abs=0.01)
    world.run(2.0)
    assert watched(world).result("motion.open")["ok"]


@pytest.mark.parametrize("heard", HEARD)
@pytest.mark.parametrize("value", [25.0, 6.0])
def test_a_stiff_hold_does_not_lurch_when_its_scale_changes(value: float, heard: str) -> None:
    world, client = enabled_world()
    client.result("motion.move", opening_mm=30)
    world.run(0.5)
    before_mm = world.gripper.opening_mm
    write(world, PMAX, value, heard)
    course = observe(world, 0.5)
    assert max(abs(mm - before_mm) for mm in course.openings_mm) < 0.5
    assert max(course.torques_nm) < 0.5
    assert world.in_phase(MotorPhase.ENABLED)
    world.gripper.push(1.0)
    world.run(0.3)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=2.0)  # as stiff as before


@pytest.mark.parametrize("heard", HEARD)
def test_a_watchdog_that_is_switched_off_while_enabled_is_set_again(heard: str) -> None:
    world, client = gripping()
    write(world, TIMEOUT, 0, heard)
    assert world.gripper.motor.registers.timeout_s == 0.0
    world.run(0.1)
    assert world.gripper.motor.registers.timeout_s == pytest.approx(0.1)
    assert world.in_phase(MotorPhase.ENABLED)
    assert any("TIMEOUT" in event["message"] for event in events(client, "motor"))
    world.run(3.0)
    assert [e["data"]["active"] for e in events(client, "second_master")] == [True, False]


def test_a_watchdog_is_set_again_though_writes_are_lost() -> None:
    world, _ = gripping()
    write(world, TIMEOUT, 0)
    writes = LosesFirst(5, lambda frame: frame.can_id == REGISTER_CAN_ID and frame.data[2] == 0x55)
    world.lose_to_motor = writes
    world.run(0.5)
    assert writes.left == 0
    assert world.gripper.motor.registers.timeout_s == pytest.approx(0.1)
    assert world.in_phase(MotorPhase.ENABLED)


@pytest.mark.parametrize("heard", [*HEARD, "none"])
def test_a_motor_that_obeys_no_commands_any_more_is_disabled_with_the_reason(heard: str) -> None:
    world, client = enabled_world()
    number = client.send("motion.open")
    world.run(0.3)
    world.controller.second_master.is_tolerated = True  # else it alone would end the motion
    write(world, CONTROL_MODE, 2, heard)
    world.run(0.1)
    assert world.gripper.motor.status == Status.DISABLED
    if heard != "none":
        assert reason_of(client.answered(number)) == "motor_unsuitable"
    world.run(2.5)
    error = client.call("motor.enable")["error"]["data"]
    assert (error["reason"], error["register"]) == ("motor_unsuitable", "CTRL_MODE")
    world.gripper.motor.registers.write(10, struct.pack("<I", 1))
    assert client.result("motor.clear_fault")["cleared"] == "motor_unsuitable"
    assert client.result("motor.enable")["ok"]


@pytest.mark.parametrize("heard", HEARD)
def test_a_motor_that_answers_on_another_id_is_followed(heard: str) -> None:
    world, _ = gripping()
    write(world, MASTER_ID, 0x19, heard)
    course = observe(world, 0.5)
    assert min(course.torques_nm) > 0.8 * FORCE_NM
    assert world.identity.master_id == 0x19
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.state.is_grasped
    assert not world.state.stale


def test_a_motor_that_is_made_to_answer_on_its_own_command_id_is_disabled() -> None:
    world, client = gripping()
    write(world, MASTER_ID, CAN_ID)
    world.run(0.3)
    assert world.gripper.motor.status == Status.DISABLED
    world.run(2.5)
    assert client.refusal("motor.enable") == "motor_unsuitable"
    assert [e["data"]["active"] for e in events(client, "second_master")] == [True, False]


@pytest.mark.parametrize("heard", [*HEARD, "none"])
@pytest.mark.parametrize(("register", "value"), WRITES)
def test_what_was_written_while_disabled_is_known_before_the_motor_is_enabled(
    register: Register, value: float, heard: str
) -> None:
    world = World().start()
    client = watched(world)
    world.run(0.2)
    true_rad = world.gripper.position_rad
    write(world, register, value, heard)
    world.run(0.06 if heard == "none" else 2.5)
    if register is CONTROL_MODE:
        assert client.refusal("motor.enable") == "motor_unsuitable"
        return
    if register is MASTER_ID and heard == "none":
        world.run(1.0)  # silent, and found again
    assert client.result("motor.enable")["ok"]
    course = observe(world, 0.3)
    assert max(course.torques_nm) < 0.2
    assert world.gripper.position_rad == pytest.approx(true_rad, abs=0.005)
    assert world.state.position_rad == pytest.approx(true_rad, abs=0.005)
    assert world.gripper.motor.registers.timeout_s == pytest.approx(0.1)
    assert world.gripper.motor.registers.ranges == type(world.gripper.motor.registers.ranges)(
        world.ranges.position_rad, world.ranges.velocity_rad_s, world.ranges.torque_nm
    )
    reported = events(client, "second_master")
    assert [event["data"]["active"] for event in reported] == (
        [] if heard == "none" else [True, False]
    )
    if register in (PMAX, VMAX, TMAX):
        assert any(register.name in event["message"] for event in events(client, "motor"))


@pytest.mark.parametrize("heard", HEARD)
def test_a_write_is_told_by_name_and_value_and_refuses_motions(heard: str) -> None:
    world, client = gripping()
    write(world, TMAX, 54.0, heard)
    world.run(0.05)
    assert client.refusal("motion.open") == "second_master"
    (reported,) = events(client, "second_master")
    assert "TMAX to 54" in reported["message"]
    assert (reported["data"]["frames"], reported["data"]["register"]) == (1, "TMAX")
    assert reported["data"]["value"] == 54.0
    world.run(2.0)
    assert client.result("motion.open")["ok"]


def test_a_save_is_a_second_masters_frame_and_a_read_is_not() -> None:
    world = World().start()
    client = watched(world)
    world.inject(read_request(CAN_ID, TMAX))
    world.inject(CanFrame(REGISTER_CAN_ID, bytes([CAN_ID + 1, 0, 0x55, 23, 0, 0, 0, 0])))
    world.run(0.1)
    assert not events(client, "second_master")
    world.inject(CanFrame(REGISTER_CAN_ID, bytes([CAN_ID, 0, 0xAA, 1])))
    world.run(0.1)
    (reported,) = events(client, "second_master")
    assert "saves the motor's registers" in reported["message"]


def test_our_own_write_of_the_watchdog_is_no_second_masters() -> None:
    world = World()
    world.gripper.motor.registers.write(9, bytes(4))
    client = watched(world.start())
    assert client.result("motor.enable")["ok"]
    world.run(0.5)
    assert not events(client, "second_master")


def test_a_write_while_the_motor_is_being_enabled_ends_that() -> None:
    world = World().start()
    world.controller.second_master.is_tolerated = True
    client = watched(world)
    world.lose_to_motor = lambda frame: frame.data[7:] == b"\xfc"  # the enable frames are lost
    number = client.send("motor.enable")
    world.run(0.1)
    assert world.in_phase(MotorPhase.ENABLING)
    write(world, TMAX, 54.0)
    assert reason_of(client.wait(number, 1.0)) == "second_master"
    world.lose_to_motor = lambda _frame: False
    world.run(0.1)
    assert world.gripper.motor.status == Status.DISABLED
    assert client.result("motor.enable")["ok"]


def test_a_claim_that_the_motor_does_not_confirm_changes_nothing() -> None:
    """A frame with the shape of the motor's answer, which the motor did not send."""
    world, _ = gripping()
    for value in (1.0, 54.0, float("nan"), 1e30):
        data = bytes([CAN_ID, 0, 0x55, TMAX.number]) + TMAX.encode(value)
        world.inject(CanFrame(0x18, data))
        course = observe(world, 0.3)
        assert max(course.torques_nm) < 1.3 * FORCE_NM
        assert course.torques_nm[-1] == pytest.approx(FORCE_NM, abs=0.15)
        assert world.ranges.torque_nm == 10.0
    data = bytes([CAN_ID, 0, 0x55, PMAX.number]) + PMAX.encode(25.0)
    world.inject(CanFrame(0x18, data))
    world.run(0.3)
    assert world.ranges.position_rad == 12.5
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.machine.motor.view().problem is None


def test_enabling_takes_no_longer_for_reading_all_registers() -> None:
    world, client = found_world()
    world.run(0.2)
    began_s = world.now_s
    assert client.result("motor.enable")["ok"]
    assert world.now_s - began_s <= 5.5 * PERIOD_S


def test_a_range_that_makes_no_sense_disables_the_motor() -> None:
    world, _ = gripping()
    write(world, TMAX, 2000.0)
    course = observe(world, 0.3)
    assert max(course.torques_nm[5:]) < 1.3 * FORCE_NM
    assert world.gripper.motor.status == Status.DISABLED
    world.run(2.5)
    assert watched(world).refusal("motor.enable") == "motor_unsuitable"
