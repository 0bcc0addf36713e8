"""Courses of events that are rare, and would be dangerous if they went wrong."""

from typing import Any

import pytest

from litegripd.model.motor import CanFrame, MotorPhase, Status
from litegripd.motor import codec
from tests.world import CAN_ID, World, is_command, ready


class FirstCommands:
    """Loses the first MIT commands on their way to the motor."""

    def __init__(self, count: int) -> None:
        self.left = count

    def __call__(self, frame: CanFrame) -> bool:
        if self.left and frame.can_id == CAN_ID and is_command(frame):
            self.left -= 1
            return True
        return False


@pytest.mark.parametrize("lost", [0, 1, 2, 3])
def test_a_stored_command_is_not_applied_though_zero_gain_frames_are_lost(lost: int) -> None:
    """A fault leaves a motion's command stored; a hand has moved the jaws since."""
    world, client = ready()
    client.send("motion.open")
    world.run(0.3)
    world.gripper.set_supply(40)
    world.run(0.02)
    world.gripper.set_supply(24)
    world.gripper.push(3.0)
    world.run(0.15)
    world.gripper.push(0.0)
    world.run(0.3)
    assert world.state.motor == "fault"
    before_mm = world.gripper.opening_mm
    world.lose_to_motor = FirstCommands(lost)
    number = client.send("motor.enable")
    moved_mm = world.track(0.5, lambda: abs(world.gripper.opening_mm - before_mm))
    assert client.has_answer(number)
    assert world.state.motor == "enabled"
    assert max(moved_mm) < 0.2


def test_jaws_that_are_told_to_relax_while_the_motor_is_silent_are_disabled() -> None:
    """Its answers are lost, so whether zero gains have arrived would remain unknown."""
    world, client = ready()
    world.gripper.put_object(width_mm=30.0)
    client.send("motion.close")
    world.run(0.9)
    world.lose_from_motor = lambda _frame: True
    world.run_until(lambda: world.phase is MotorPhase.SILENT, 0.1)
    client.send("stop", level="relax")
    world.run(0.02)
    assert world.gripper.motor.status == Status.DISABLED
    assert world.sent[-1].frame.data == codec.DISABLE


def test_a_silent_motor_is_stale_at_once_and_not_called_off() -> None:
    world = World()
    world.enabled()
    world.lose_from_motor = lambda _frame: True
    world.run_until(lambda: world.phase is MotorPhase.SILENT, 0.1)
    state = world.state
    assert state.stale
    assert state.enabled is None


def test_after_an_unnoticed_power_cycle_the_registers_are_read_anew() -> None:
    """What was not saved in them is lost, the ranges of every frame among it."""
    world, client = ready()
    world.gripper.power_cycle()
    world.run_until(lambda: not world.state.enabled, 0.1)
    assert world.state.motor == "unknown"
    world.run_until(lambda: world.phase is MotorPhase.DISABLED, 2.0)
    assert client.result("motor.enable")["ok"]


@pytest.mark.parametrize("params", [{"level": "now"}, {"why": 3}, {"hurry": True}])
def test_a_stop_that_is_not_understood_stops_all_the_same(params: dict[str, Any]) -> None:
    world, client = ready()
    client.send("motion.open")
    world.run(0.3)
    answer = client.call("stop", **params)
    assert "stopped (hold) all the same" in answer["error"]["message"]
    assert world.state.stop is not None
    assert world.state.mode == "holding"
