"""Remedies of docs/troubleshooting.md for what no refusal names: each is done, and it helps.

The commands are the page's: `grasp --force 20` is `motion.grasp` with 20 N, and so on.
"""

from typing import Any

import pytest

from tests.app.test_facts import verdict
from tests.control.held import WIDTH_MM, Held
from tests.control.states import at_opening
from tests.control.test_stream import follow
from tests.world import Client, ready


def grasped(client: Client, **params: Any) -> str:
    client.result("motion.open")
    result = client.result("motion.grasp", until="verdict", **{"force_n": 10.0, **params})
    return str(result["outcome"])


def test_a_thin_object_is_found_with_a_smaller_margin() -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.put_object(width_mm=3.0)
    assert grasped(client) == "no_object"
    assert grasped(client, config={"margin": 0.02}) == "object_held"
    world.gripper.remove_object()
    assert grasped(client, config={"margin": 0.02}) == "no_object"


@pytest.mark.parametrize("torque_nm", [1.2, 1.5])
def test_jaws_that_are_weighed_down_hold_no_object_once_they_are_free_and_measured(
    torque_nm: float,
) -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.push(-torque_nm * world.gripper.parameters.close_sign)
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["outcome"] == "object_held"
    world.gripper.push(0.0)
    assert client.result("calibration.zero")["ok"]
    assert grasped(client) == "no_object"


def test_jaws_that_stick_hold_no_object_once_they_are_free_and_measured() -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.jam()
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["outcome"] == "object_held"
    world.gripper.free()
    assert client.result("calibration.zero")["ok"]
    assert grasped(client) == "no_object"


NEEDS_N = 15.0
"""An object that slips out of jaws which hold it with less, as soon as something pulls at it."""


def pulled(held: Held) -> list[dict[str, Any]]:
    """Pull at what is held; return what is then said to be lost."""
    if held.clamp_n < NEEDS_N:
        held.gripper.remove_object()
    held.run(1.0)
    return held.events("object_lost")


def test_what_slips_out_is_held_with_more_force() -> None:
    assert len(pulled(Held(10.0))) == 1
    held = Held(20.0)
    assert pulled(held) == []
    assert held.state.is_grasped


def test_a_weak_motor_is_no_longer_said_to_be_one_once_its_supply_is_right() -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.put_object(width_mm=WIDTH_MM)
    world.gripper.weaken(0.5)
    client.send("motion.grasp", force_n=30.0)
    world.run(3.0)
    judged, reasons = verdict(world)
    assert judged == "degraded"
    assert "check the supply's voltage and current" in reasons[0]
    world.gripper.weaken(1.0)
    world.run(2.0)
    assert verdict(world) == ("ok", [])


def test_jaws_that_stand_without_a_word_show_torque_and_go_on_when_they_are_free() -> None:
    """Set-points have no outcome: the state alone shows that something jams the jaws."""
    world, client = at_opening(60.0)
    world.gripper.jam()
    follow(world, client, 2.0, opening_mm=30.0)
    assert world.gripper.opening_mm == pytest.approx(60.0)
    assert abs(world.state.torque_nm or 0.0) > 0.5
    world.gripper.free()
    follow(world, client, 2.0, opening_mm=30.0)
    assert world.gripper.opening_mm == pytest.approx(30.0, abs=2.0)


def test_a_plug_that_was_out_answers_when_it_is_in_and_the_bus_shows_it() -> None:
    world, client = ready()
    world.lose_to_motor = world.lose_from_motor = lambda _frame: True
    world.run(1.0)
    assert client.refusal("motion.open") == "motor_silent"
    assert verdict(world)[0] == "down"
    world.lose_to_motor = world.lose_from_motor = lambda _frame: False
    world.run(1.0)
    assert client.result("motor.enable")["ok"]
    assert client.result("motion.open")["ok"]
    assert verdict(world) == ("ok", [])
