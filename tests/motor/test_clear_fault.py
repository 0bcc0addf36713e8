"""Clearing a fault by itself: confirmed, never energising, and honest about one that stays."""

import pytest

from litegripd.model.motor import CanFrame, MotorPhase
from litegripd.motor import codec
from tests.motor.bench import LosesFirst, everything
from tests.motor.test_silence import moving
from tests.world import CAN_ID, PERIOD_S, World, enabled_world, found_world


def faulty() -> World:
    """Return a world whose motor has latched a fault: the supply has risen, and fallen again."""
    world, _ = moving()
    latch(world)
    return world


def latch(world: World) -> None:
    world.gripper.set_supply(40.0)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    world.gripper.set_supply(24.0)


def test_a_fault_is_cleared_and_the_motor_stays_disabled() -> None:
    world = faulty()
    client = world.client()
    since_s = world.now_s + PERIOD_S / 2
    assert client.result("motor.clear_fault")["cleared"] == "over_voltage"
    world.run(0.5)
    assert world.in_phase(MotorPhase.DISABLED)
    assert set(world.own_frames(since_s)) == {codec.CLEAR_FAULT}
    assert client.refusal("motion.open") == "not_enabled"
    assert client.result("motor.enable")["ok"]


def test_a_fault_that_stays_is_the_answer() -> None:
    world, _ = moving()
    world.gripper.set_supply(0.0)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    data = world.client().refused("motor.clear_fault", "motor_fault")
    assert data["status"] == "under_voltage"
    assert world.in_phase(MotorPhase.FAULT)


@pytest.mark.parametrize("lost", [1, 3])
def test_a_lost_frame_is_sent_again(lost: int) -> None:
    world = faulty()
    world.lose_to_motor = LosesFirst(lost, everything)
    assert world.client().result("motor.clear_fault")["ok"]


def test_without_a_fault_nothing_is_cleared() -> None:
    world, client = found_world()
    assert client.result("motor.clear_fault")["cleared"] is None
    assert client.result("motor.enable")["ok"]
    assert client.refusal("motor.clear_fault") == "out_of_limits"
    assert world.in_phase(MotorPhase.ENABLED)


def test_a_silent_motor_cannot_confirm() -> None:
    world = World().start()
    world.lose_to_motor = lambda _frame: True
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 2.0)
    assert world.client().refusal("motor.clear_fault") == "motor_silent"


def test_a_stop_does_not_forbid_it() -> None:
    world = faulty()
    client = world.client()
    client.result("stop")
    assert client.result("motor.clear_fault")["cleared"] == "over_voltage"
    assert client.refusal("motor.enable") == "stopped"


def test_a_fault_that_somebody_else_has_cleared_is_over() -> None:
    """The maker's tool, or the motor itself: it is a disabled motor then, ready to be enabled."""
    world, client = enabled_world()
    latch(world)
    world.run(0.2)
    assert world.in_phase(MotorPhase.FAULT)
    world.gripper.receive(world.now_s, CanFrame(CAN_ID, codec.CLEAR_FAULT))
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 0.5)
    assert world.state.status == "disabled"
    assert client.refusal("motion.open") == "not_enabled"
    assert client.result("motor.enable")["ok"]
