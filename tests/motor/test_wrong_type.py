"""A motor of another type than the configured one: it is reported, and not enabled."""

import math
import struct
from dataclasses import replace

import pytest

from litegripd.model.gripper import DM4310, DM4340, MotorType
from litegripd.model.motor import CanFrame, MotorPhase
from litegripd.motor.identity import unsuitable
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from tests.motor.helpers import set_register
from tests.motor.test_register_scan import disturbed_once, identity_with
from tests.world import CAN_ID, World

GR = 20
BOTH_WAYS = pytest.mark.parametrize(
    ("configured", "on_the_bus"), [(DM4310, DM4340), (DM4340, DM4310)], ids=lambda row: row.name
)


def world_of(configured: MotorType, on_the_bus: MotorType) -> World:
    return World(motor_type=configured, parameters=SimulatorParameters().of_motor(on_the_bus))


@BOTH_WAYS
def test_it_is_refused_with_what_was_read_against_what_the_type_has(
    configured: MotorType, on_the_bus: MotorType
) -> None:
    world = world_of(configured, on_the_bus).start()
    refused = world.client().call("motor.enable")["error"]
    assert refused["data"]["reason"] == "motor_unsuitable"
    assert refused["data"]["register"] == "Gr"
    assert refused["data"]["value"] == on_the_bus.gear_ratio
    assert refused["data"]["fits"] == [on_the_bus.name]
    for row in (configured, on_the_bus):
        spans = (row.ranges.position_rad, row.ranges.velocity_rad_s, row.ranges.torque_nm)
        assert ", ".join(f"{figure:g}" for figure in (row.gear_ratio, *spans)) in refused["message"]
    assert f"the motor is no {configured.name}" in refused["message"]
    assert f'set [motor] type = "{on_the_bus.name}"' in refused["message"]
    assert "hw_ver 306, sw_ver 5015" in refused["message"]
    world.run(1.0)
    assert world.phase is MotorPhase.DISABLED
    assert not [sent for sent in world.sent if sent.frame.can_id == CAN_ID]


@BOTH_WAYS
def test_one_that_does_not_answer_its_ratio_is_told_by_its_ranges(
    configured: MotorType, on_the_bus: MotorType
) -> None:
    world = world_of(configured, on_the_bus)
    world.lose_from_motor = lambda frame: frame.data[2:4] == bytes([0x33, GR])
    refused = world.start().client().call("motor.enable")["error"]
    assert refused["data"]["register"] == "TMAX"
    assert refused["data"]["fits"] == [on_the_bus.name]
    assert "unknown, 12.5" in refused["message"]


@BOTH_WAYS
def test_one_that_is_found_enabled_is_disabled(
    configured: MotorType, on_the_bus: MotorType
) -> None:
    world = world_of(configured, on_the_bus)
    world.gripper.receive(world.now_s, CanFrame(CAN_ID, b"\xff" * 7 + b"\xfc"))
    assert world.gripper.motor.status == 1
    world.run(0.5)
    assert world.gripper.motor.status == 0
    assert world.client().refusal("motor.enable") == "motor_unsuitable"


@BOTH_WAYS
def test_the_right_one_in_its_place_is_usable_after_clear_fault(
    configured: MotorType, on_the_bus: MotorType
) -> None:
    world = world_of(configured, on_the_bus).start()
    client = world.client()
    assert client.refusal("motor.enable") == "motor_unsuitable"
    world.gripper = SimulatedGripper(SimulatorParameters().of_motor(configured))
    assert client.result("motor.clear_fault")["cleared"] == "motor_unsuitable"
    assert client.result("motor.enable")["ok"]


@BOTH_WAYS
def test_a_wrong_one_that_comes_in_the_place_of_the_right_one_is_not_enabled(
    configured: MotorType, on_the_bus: MotorType
) -> None:
    """Its ratio is not read again, but its ranges are, before each enabling."""
    world = world_of(configured, configured)
    client = world.enabled()
    assert client.result("motor.disable")["ok"]
    world.gripper = SimulatedGripper(SimulatorParameters().of_motor(on_the_bus))
    assert client.refusal("motor.enable") == "motor_unsuitable"
    assert world.gripper.motor.status == 0
    world.run(0.1)
    answer = client.call("motor.clear_fault")["error"]  # that reads all
    assert answer["data"]["register"] == "Gr"


def test_a_ratio_that_no_type_has_is_refused_too() -> None:
    refusal = unsuitable(identity_with(registers={"Gr": 25.0}), None)
    assert refusal is not None
    assert refusal.data["fits"] == []
    assert refusal.data["value"] == 25.0
    assert "set [motor] type" not in refusal.message
    assert unsuitable(identity_with(registers={"Gr": 10.4}), None) is None


def test_a_ratio_that_no_gear_has_leaves_it_to_the_ranges() -> None:
    for ratio in (0.0, 1.0, math.nan, math.inf):
        found = identity_with(registers={"Gr": ratio})
        assert unsuitable(found, None) is None
        others = replace(found, ranges=DM4340.ranges)
        refusal = unsuitable(others, None)
        assert refusal is not None
        assert refusal.data["fits"] == ["DM4340"]


def test_ranges_that_somebody_has_set_do_not_make_another_type() -> None:
    """They are used as they are, with a warning."""
    world = World(motor_type=DM4340)
    set_register(world, 23, struct.pack("<f", 20.0))
    assert world.enabled()
    assert world.identity.ranges.torque_nm == 20.0


def test_one_disturbed_answer_does_not_make_another_type() -> None:
    world = World()
    disturbed_once(world, GR, struct.pack("<f", 40.0))
    assert world.start().client().result("motor.enable")["ok"]
