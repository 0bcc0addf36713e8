"""A hold by force survives what can be survived: lost frames, a short silence, a lost client."""

import pytest

from litegripd.model.motor import MotorPhase
from tests.world import PERIOD_S, Client, World, ready


def gripping(force_n: float = 20.0) -> tuple[World, Client]:
    """Return a gripper that holds an object of 40 mm by force, and its client."""
    world, client = ready()
    world.gripper.put_object(width_mm=40.0)
    assert client.result("motion.grasp", force_n=force_n, until="verdict")["ok"]
    world.run(1.5)
    return world, client


def squeezed_n(world: World) -> float:
    return world.torque_nm * 10.0


@pytest.mark.parametrize("silence_s", [PERIOD_S, 3 * PERIOD_S, 0.03, 0.06])
def test_an_object_is_held_through_a_silence_that_the_motor_survives(silence_s: float) -> None:
    world, client = gripping()
    world.lose_from_motor = lambda _frame: True
    forces_n = world.track(silence_s, lambda: squeezed_n(world))
    world.lose_from_motor = lambda _frame: False
    forces_n += world.track(0.5, lambda: squeezed_n(world))
    assert world.in_phase(MotorPhase.ENABLED)
    assert min(forces_n) > 15.0
    assert squeezed_n(world) == pytest.approx(20.0, abs=1.0)
    assert world.state.is_grasped
    assert client.result("motion.open")["ok"]


def test_a_force_that_rises_goes_on_after_a_silence_from_where_it_was() -> None:
    world, client = gripping(5.0)
    rate_nm_s = world.controller.config.force_rate_n_s / 10.0
    client.result("motion.set_force", force_n=25.0)
    world.run(0.2)
    world.lose_from_motor = lambda _frame: True
    since_s = world.now_s
    world.run(0.06)
    before_nm = abs(world.commands_since(since_s)[-1][1].torque_nm)
    world.lose_from_motor = lambda _frame: False
    since_s = world.now_s
    world.run(0.02)
    assert world.in_phase(MotorPhase.ENABLED)
    after_nm = abs(world.commands_since(since_s)[-1][1].torque_nm)
    assert before_nm < after_nm < before_nm + rate_nm_s * (0.02 + 2 * PERIOD_S)


def test_an_object_that_vanishes_in_a_silence_is_noticed_after_it() -> None:
    world, _ = gripping()
    watcher = world.client()
    watcher.result("events.subscribe")
    world.lose_from_motor = lambda _frame: True
    world.run(0.04)
    world.gripper.remove_object()
    world.run(0.02)
    world.lose_from_motor = lambda _frame: False
    world.run(1.0)
    assert not world.state.is_grasped
    assert watcher.events("object_lost")


def test_a_silence_that_the_motor_does_not_survive_ends_in_a_disabled_motor() -> None:
    world, client = gripping()
    world.lose_to_motor = lambda _frame: True
    world.run(0.5)
    world.lose_to_motor = lambda _frame: False
    world.run_until(lambda: world.machine.is_disabled, 2.0)
    assert client.refusal("motion.open") in ("motor_fault", "not_enabled")


def test_the_force_is_held_though_the_configuration_changes_and_the_client_dies() -> None:
    world, client = gripping()
    client.leave()
    admin = world.client()
    assert "error" not in admin.call("config.set", config={"force_n": 5})
    world.run(1.0)
    assert squeezed_n(world) == pytest.approx(20.0, abs=1.0)


def test_a_motion_that_is_cancelled_before_it_begins_changes_nothing() -> None:
    world, client = gripping()
    job = client.send("motion.open", wait=False)
    client.read()
    client.send("job.cancel", job=client.answers[job]["result"]["job"])
    world.run(1.0)
    assert world.state.is_grasped
    assert squeezed_n(world) == pytest.approx(20.0, abs=1.0)


def test_a_hold_that_a_hand_has_pressed_beyond_a_stop_does_not_press_on() -> None:
    world, client = ready()
    client.result("motion.close")
    sign = world.gripper.parameters.close_sign
    client.result("stop", level="relax")
    world.gripper.push(3.0 * sign)
    world.run(0.5)
    client.result("stop.clear")
    client.result("motion.hold")
    world.run(0.5)
    assert world.gripper.opening_mm < -3.0
    world.gripper.push(0.0)
    world.run(2.0)
    assert squeezed_n(world) < 7.0  # as at the calibrated stop; it would be 21
    assert world.state.mode == "holding"
    held_mm = world.gripper.opening_mm
    world.gripper.push(-1.0 * sign)  # and holds as stiff as ever
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(held_mm, abs=2.0)
