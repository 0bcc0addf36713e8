"""What is in force when a stop comes stays, on plants that are no simulator, and over a silence."""

from collections.abc import Callable

import pytest

from litegripd.control.holds import Hold
from litegripd.control.limiter import DEFAULT_GAINS
from tests.faults.stopped import CALLED, LIMITS, OBJECT_MM, RESTS, STILL_RAD, Stopped, grips
from tests.plants.parameters import MM_RAD, Item, PlantParameters
from tests.plants.world import PlantWorld
from tests.plants.worst import SWINGING
from tests.world import Client, World, ready


def _grips(world: World, client: Client) -> None:
    assert isinstance(world, PlantWorld)
    world.mechanics.put(Item(OBJECT_MM))
    grips(world, client)


@pytest.mark.parametrize("rest", [*(rest.begin for rest in RESTS[:2]), _grips])
@pytest.mark.parametrize("name", ["usual", "damping, fast filter"])
def test_all_methods_in_a_row_move_no_other_gripper_either(
    name: str, rest: Callable[[World, Client], None]
) -> None:
    plant = {"usual": PlantParameters(), **SWINGING}[name]
    world = PlantWorld(plant, "normal", 200, opening_mm=60.0)
    mechanics = world.mechanics
    under = Stopped(world, lambda: (mechanics.opening_mm / MM_RAD, mechanics.torque_nm))
    under.begin(rest)
    under.try_out([method for method in CALLED if method.role != "observer"], ["admin"])
    assert under.moved_rad < STILL_RAD


def silent(world: World, duration_s: float) -> None:
    world.lose_to_motor = lambda _frame: True
    world.run(duration_s)
    world.lose_to_motor = lambda _frame: False
    world.run(0.05)


def test_gains_that_are_loaded_under_a_stop_do_not_come_with_a_short_silence() -> None:
    world, client = ready()
    client.result("motion.move", opening_mm=40)
    before = world.controller.idle
    client.result("stop")
    client.result("calibration.load", content={**LIMITS, "kp": 500, "kd": 1})
    silent(world, 0.05)
    idle = world.controller.idle
    assert isinstance(before, Hold)
    assert isinstance(idle, Hold)
    assert idle.gains == before.gains == DEFAULT_GAINS
    client.result("stop.clear")
    client.result("motion.move", opening_mm=42)
    idle = world.controller.idle
    assert isinstance(idle, Hold)
    assert idle.gains.kp_nm_rad == 500.0  # from the next motion on


def test_a_press_outlives_a_short_silence() -> None:
    world, client = ready()
    assert client.result("motion.close")["ok"]
    world.run(0.3)
    before_nm = world.gripper.motor_torque_nm
    assert before_nm > 0.4
    silent(world, 0.05)
    world.run(0.5)
    assert world.gripper.motor_torque_nm == pytest.approx(before_nm, abs=0.02)


def test_a_strong_grip_keeps_its_force_when_the_calibration_is_given_up() -> None:
    world, client = ready()
    world.gripper.put_object(width_mm=OBJECT_MM)
    grips(world, client)
    client.result("calibration.load", content={**LIMITS, "calibrated": False})
    world.run(0.5)
    assert world.torque_nm == pytest.approx(3.0, abs=0.05)
