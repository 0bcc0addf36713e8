"""Measuring the travel of grippers with much friction: true stops, or a refusal that says why."""

import pytest

from tests.control.plants import Plant, random_plant
from tests.world import Client, World

NEAR_MM = 1.5
STICKS_A_CLOSE = (10, 52, 56)
"""At 100 Hz, jaws that stick by 1.0 to 1.4 N·m, which is more than a close presses with."""
STICKS_SHORT = (5, 47, 52, 53, 56)
"""Where the probe alone sticks 8 to 15 mm in front of the closed stop."""
DOES_NOT_START = 10
"""Where the probe alone stays 50 mm short of the open one."""


def zero(plant: Plant) -> tuple[World, Client, dict[str, object], float]:
    """Return the result, and the strongest true torque meanwhile."""
    world, client = plant.world()
    number = client.send("calibration.zero", mount=plant.mount)
    strongest_nm = max(client.track(number, lambda: world.torque_nm))
    return world, client, client.answers[number]["result"], strongest_nm


@pytest.mark.parametrize("seed", [*STICKS_SHORT, DOES_NOT_START, 2, 11, 107])
def test_what_is_saved_is_where_a_close_and_an_open_end(seed: int) -> None:
    plant = random_plant(seed)
    world, client, result, strongest_nm = zero(plant)
    assert strongest_nm < 2.05
    if not result["ok"]:
        assert seed in (2, 11)
        assert "raise" in str(result["message"])
        assert world.disk.saved == {}
        return
    sign, scale = plant.parameters.close_sign, plant.parameters.rad_to_mm
    closed_rad, open_rad = plant.contact_rad
    short_mm = (closed_rad - float(str(result["closed_rad"]))) * sign * scale
    assert short_mm < NEAR_MM
    assert (float(str(result["open_rad"])) - open_rad) * sign * scale < NEAR_MM
    for method, side in (("motion.open", "open_rad"), ("motion.close", "closed_rad")):
        outcome = client.result(method)["outcome"]
        apart_rad = abs(world.gripper.position_rad - float(str(result[side])))
        if seed in STICKS_A_CLOSE and method == "motion.close":
            assert outcome == "blocked"  # and says so
            assert apart_rad * scale < 2.2
            continue
        assert outcome == "pressed_home"
        assert apart_rad * scale < NEAR_MM


def test_friction_above_what_a_close_presses_with_is_told() -> None:
    world, client = random_plant(47).world()
    before = world.controller.calibrated.calibration
    config = {"stop_lead_mm": 0.2}
    number = client.send("calibration.zero", mount="reverse", config=config)
    result = client.wait(number, 40.0)["result"]
    assert (result["ok"], result["outcome"]) == (False, "not_confirmed")
    assert "stop_lead_mm" in result["message"]
    assert world.controller.calibrated.calibration is before
    assert world.disk.saved == {}
