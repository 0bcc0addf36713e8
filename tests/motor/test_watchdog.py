"""The motor's own watchdog is on before the motor is enabled, or the motor is not enabled."""

import struct

import pytest

from litegripd.model.motor import Status
from tests.motor.helpers import world_with
from tests.world import CAN_ID, World


def timeouts_of(world: World) -> list[bytes]:
    return [s.frame.data for s in world.sent if s.frame.data[2] == 0x55]


@pytest.mark.parametrize("units", [0, 20001, 0xFFFFFFFF])
def test_a_watchdog_that_is_off_or_useless_is_set_before_the_first_enable(units: int) -> None:
    world = world_with(9, struct.pack("<I", units))
    world.start()
    assert not timeouts_of(world)
    client = world.client()
    assert client.result("motor.enable")["ok"]
    assert timeouts_of(world)[0].hex() == "08005509d0070000"
    assert world.gripper.motor.registers.timeout_s == pytest.approx(0.1)
    own = [s.frame.data for s in world.sent if s.frame.can_id == CAN_ID]
    index = next(i for i, s in enumerate(world.sent) if s.frame.can_id == CAN_ID)
    assert own
    assert any(s.frame.data[2] == 0x55 for s in world.sent[:index])
    assert not any(s.frame.data[2] == 0xAA and s.frame.can_id == 0x7FF for s in world.sent)


@pytest.mark.parametrize("units", [2000, 4000, 8000])
def test_a_watchdog_that_is_on_is_left_as_it_is(units: int) -> None:
    world = world_with(9, struct.pack("<I", units))
    world.enabled()
    assert not timeouts_of(world)


def test_a_watchdog_that_a_power_cycle_has_reset_is_set_anew() -> None:
    """Written without saving by an earlier run, it is gone after a power cycle."""
    world = World()
    registers = world.gripper.motor.registers
    registers.write(9, struct.pack("<I", 0))
    registers.save()
    registers.write(9, struct.pack("<I", 2000))
    world.start()
    world.gripper.power_cycle()
    assert world.client().result("motor.enable")["ok"]
    assert registers.timeout_s == pytest.approx(0.1)


def test_a_watchdog_that_cannot_be_set_forbids_enabling() -> None:
    world = world_with(9, struct.pack("<I", 0))
    world.start()
    world.lose_to_motor = lambda frame: frame.data[2] == 0x55
    world.client().refused("motor.enable", "motor_unsuitable", "TIMEOUT")
    assert not [s for s in world.sent if s.frame.data == b"\xff" * 7 + b"\xfc"]
    assert world.gripper.motor.status == Status.DISABLED
    world.lose_to_motor = lambda _frame: False
    world.run(0.1)
    assert world.client().result("motor.enable")["ok"]


def test_the_watchdog_disarms_a_motor_whose_daemon_has_died() -> None:
    world = world_with(9, struct.pack("<I", 0))
    world.enabled()
    assert world.gripper.motor.status == Status.ENABLED
    world.gripper.advance(world.now_s + 0.2)
    assert world.gripper.motor.status == Status.COMMUNICATION_LOST
