"""A motor stores what it is told while it is off, and whoever enables it sets that off."""

from litegripd.model.motor import CanFrame
from litegripd.motor import codec
from tests.faults.fault_world import FaultWorld
from tests.world import CAN_ID


def moved_by_an_enable(world: FaultWorld) -> float:
    """Let somebody else enable the motor; return how far the jaws then move, in mm."""
    before_mm = world.gripper.opening_mm
    world.inject(CanFrame(CAN_ID, codec.ENABLE))
    return max(world.track(0.1, lambda: abs(world.gripper.opening_mm - before_mm)))


def test_who_enables_the_motor_finds_no_motion_of_ours_in_it() -> None:
    """A motor stores what it is told while it is off, and applies it when it is enabled."""
    world = FaultWorld()
    client = world.enabled()
    client.send("motion.close")
    world.run(0.2)
    world.gripper.latch_fault(0xC)
    world.run(0.2)
    client.result("motor.clear_fault")
    world.run(0.3)
    assert moved_by_an_enable(world) < 0.01


def test_nor_where_it_was_somebody_else_who_disabled_it() -> None:
    world = FaultWorld()
    client = world.enabled()
    client.send("motion.close")
    world.run(0.2)
    world.inject(CanFrame(CAN_ID, codec.DISABLE))
    world.run(1.0)
    assert moved_by_an_enable(world) < 0.01
