"""Scenes of opening, closing, holding and stopping, on both mounts."""

import pytest

from litegripd.model.motor import MotorPhase
from tests.world import CAN_ID, World, ready

MOUNTS = ("normal", "reverse")


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_move_takes_the_time_that_its_speed_says(mount: str) -> None:
    world, client = ready(mount)
    client.result("motion.close")
    began_s = world.now_s
    client.send("motion.open", speed_mm_s=25.0)
    world.run_until(lambda: world.gripper.opening_mm > 80.0)
    assert world.gripper.opening_mm / (world.now_s - began_s) == pytest.approx(25, rel=0.1)


def test_nothing_is_energised_until_a_client_asks() -> None:
    world = World().start()
    world.run(5.0)
    assert world.phase is MotorPhase.DISABLED
    assert not [s for s in world.sent if s.frame.can_id == CAN_ID]


def test_holding_what_is_held_keeps_its_force() -> None:
    """Holding the measured position again would give way a little with every call."""
    world, client = ready()
    client.result("motion.close")
    world.run(0.5)
    held_rad = world.commands_since(world.now_s - 0.02)[-1][1].position_rad
    for _ in range(5):
        client.result("motion.hold")
        world.run(0.2)
    assert world.commands_since(world.now_s - 0.02)[-1][1].position_rad == held_rad


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("thrown_rad_s", [4.0, 9.0, 14.0, 20.0])
def test_held_jaws_that_are_thrown_come_to_rest(mount: str, thrown_rad_s: float) -> None:
    """What was measured is two ticks old: no limit may feed it back, or they shake for ever."""
    world = World(mount)
    world.enabled().result("motion.move", opening_mm=60, speed_mm_s=100)
    world.gripper.push(6.0)
    world.run_until(lambda: "torque" in world.state.limited)  # the peak is used up
    world.gripper.push(0.0)
    world.gripper._drive._velocity = thrown_rad_s
    world.run(1.0)
    assert max(world.track(0.1, lambda: abs(world.gripper.velocity_rad_s))) < 0.05


@pytest.mark.parametrize("thrown_rad_s", [4.0, 9.0, 14.0, 20.0])
def test_jaws_of_unknown_travel_that_are_thrown_come_to_rest(thrown_rad_s: float) -> None:
    world = World(calibrated=False)
    world.enabled()
    world.gripper._drive._velocity = thrown_rad_s
    world.run(1.0)
    assert max(world.track(0.1, lambda: abs(world.gripper.velocity_rad_s))) < 0.05
