"""A motor whose MST_ID equals its ESC_ID: it answers on the very id that it is commanded by."""

import struct

import pytest

from litegripd.model.motor import CanFrame, MotorPhase, Status
from litegripd.motor import codec
from litegripd.sim.plant import SimulatorParameters
from tests.world import CAN_ID, Client, World

ENABLE = CanFrame(CAN_ID, codec.ENABLE)


def world_of_one_id() -> tuple[World, Client]:
    world = World(parameters=SimulatorParameters(master_id=CAN_ID))
    client = world.client()
    client.result("events.subscribe", kinds=["second_master"])
    return world, client


def test_it_is_found_and_told_in_clear_words() -> None:
    world, client = world_of_one_id()
    world.start()
    data = client.refused(
        "motor.enable",
        "motor_unsuitable",
        "0x08",
        "MST_ID and ESC_ID are equal",
        "maker's tool",
        "0x18",
    )
    assert data["register"] == "MST_ID"
    world.run(3.0)
    assert not [s for s in world.sent if s.frame == ENABLE]
    assert not client.told("event")
    assert world.machine.motor.counters.foreign_commands == 0
    assert world.in_phase(MotorPhase.DISABLED)


def test_it_is_disabled_when_it_is_found_enabled() -> None:
    world, client = world_of_one_id()
    world.gripper.receive(world.now_s, ENABLE)
    world.run_until(lambda: world.gripper.motor.status == Status.DISABLED, 0.08)
    world.start()
    assert not client.told("event")


def test_it_is_disabled_when_somebody_enables_it_later() -> None:
    world, client = world_of_one_id()
    world.start()
    for reply in world.gripper.receive(world.now_s, ENABLE):
        world.inject(ENABLE)
        world.inject(reply)
    world.run(0.3)
    assert world.gripper.motor.status == Status.DISABLED
    assert world.machine.motor.counters.foreign_commands == 1
    assert client.told("event")


def test_it_is_usable_once_its_register_is_set() -> None:
    world, client = world_of_one_id()
    world.start()
    assert client.refusal("motor.enable") == "motor_unsuitable"
    world.gripper.motor.registers.write(7, struct.pack("<I", 0x18))
    world.run(1.0)  # silent on the old id, and found on the new one
    assert client.result("motor.enable")["ok"]


@pytest.mark.parametrize("status", [0x8, 0xE])
def test_a_fault_of_it_is_seen(status: int) -> None:
    world, _ = world_of_one_id()
    world.gripper.latch_fault(status)
    world.run(1.0)
    assert world.in_phase(MotorPhase.FAULT)
