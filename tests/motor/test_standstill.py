"""A communication loss that the daemon itself has caused is not blamed on the wiring."""

import pytest

from litegripd.model.motor import MotorPhase, Status
from litegripd.sim.plant import SimulatorParameters
from tests.world import PERIOD_S, Client, World, enabled_world


def stand_still(world: World, duration_s: float) -> None:
    """Let time pass in which the daemon does nothing, but the motor continues."""
    world.now_s += duration_s - PERIOD_S
    world.tick()


def message_of(client: Client) -> str:
    error = client.call("motion.open")["error"]
    assert error["data"]["reason"] == "motor_fault"
    text: str = error["message"]
    return text


def cut_off(world: World, duration_s: float) -> None:
    """Let frames of both directions get lost for a while."""
    world.lose_to_motor = world.lose_from_motor = lambda _frame: True
    world.run(duration_s)
    world.lose_to_motor = world.lose_from_motor = lambda _frame: False


def test_a_daemon_that_stood_still_says_so_and_for_how_long() -> None:
    world, client = enabled_world()
    client.result("events.subscribe")
    moving = client.send("motion.open", speed_mm_s=20)
    world.run(0.5)
    stand_still(world, 0.312)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 0.1)
    assert world.gripper.motor.status == Status.COMMUNICATION_LOST
    error = client.wait(moving)["error"]
    assert "the daemon itself stood still for 312 ms" in error["message"]
    assert "wiring" not in error["message"]
    assert error["data"]["stood_still_s"] == pytest.approx(0.312)
    assert error["data"]["status"] == "communication_lost"
    world.run(5.0)
    assert message_of(client) == error["message"]  # for as long as the fault lasts
    reported = [n["params"] for n in client.notifications if n["method"] == "event"]
    assert any("stood still for 312 ms" in event["message"] for event in reported)
    assert client.result("motor.enable")["ok"]


def test_a_bus_that_was_cut_is_still_the_wiring() -> None:
    world, client = enabled_world()
    cut_off(world, 0.3)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    assert "check the CAN wiring" in message_of(client)


def test_a_standstill_explains_one_loss_and_not_a_later_one() -> None:
    world, client = enabled_world()
    stand_still(world, 0.312)
    world.run(0.5)
    assert client.result("motor.enable")["ok"]
    world.run(1.0)
    cut_off(world, 0.3)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    assert "check the CAN wiring" in message_of(client)


@pytest.mark.parametrize(("loss_s", "is_cause"), [(0.1, True), (0.4, False), (0.9, False)])
@pytest.mark.parametrize("units", [0, 2000, 8000])
def test_how_long_is_too_long_is_for_the_motor_to_say_and_not_for_its_register(
    units: int, loss_s: float, is_cause: bool
) -> None:
    """Three tenths of a second are nothing to a motor that waits for four."""
    world, client = enabled_world(
        parameters=SimulatorParameters(watchdog_s=units * 50e-6, comm_loss_s=loss_s)
    )
    stand_still(world, 0.3)
    assert world.in_phase(MotorPhase.ENABLED)
    cut_off(world, loss_s + 0.1)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    assert ("stood still" in message_of(client)) is is_cause


def test_the_first_answer_after_a_standstill_may_get_lost() -> None:
    world, client = enabled_world()
    stand_still(world, 0.15)
    cut_off(world, 0.05)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    assert "stood still for 150 ms" in message_of(client)


def test_other_faults_are_not_explained_by_a_standstill() -> None:
    world, client = enabled_world()
    stand_still(world, 0.09)
    world.gripper.set_supply(40.0)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    assert "over voltage: lower the supply voltage" in message_of(client)
