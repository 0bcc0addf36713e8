"""The first touch of a grasp, and grasps of nothing under load, on the simulated gripper."""

import math

import pytest

from litegripd.sim.plant import MOUNTS
from tests.world import Client, World, ready

WIDTH_MM = 45.0


def grasp(world: World, client: Client, **params: float) -> dict[str, object]:
    result: dict[str, object] = client.result("motion.grasp", until="verdict", **params)
    return result


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("speed_mm_s", [25.0, 50.0, 150.0])
@pytest.mark.parametrize("resistance_nm", [0.65, 0.85, 0.95])
def test_a_steady_resistance_is_no_object(
    mount: str, resistance_nm: float, speed_mm_s: float
) -> None:
    world, client = ready(
        mount,
        coulomb_nm=resistance_nm,
        breakaway_nm=1.05 * resistance_nm,
        close_stick_nm=1.0,
        closed_springback_press_nm=2.0 * resistance_nm + 0.7,
        press_torque_nm=resistance_nm + 0.1,
    )
    assert grasp(world, client, speed_mm_s=speed_mm_s)["outcome"] == "no_object"


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("speed_mm_s", [25.0, 50.0, 150.0])
@pytest.mark.parametrize("force_n", [1.0, 5.0, 20.0])
def test_a_weight_on_the_jaws_is_no_object(mount: str, force_n: float, speed_mm_s: float) -> None:
    world, client = ready(mount)
    world.gripper.push(-0.5 * world.gripper.parameters.close_sign)
    result = grasp(world, client, force_n=force_n, speed_mm_s=speed_mm_s)
    assert result["outcome"] == "no_object"


@pytest.mark.parametrize("mount", MOUNTS)
def test_jaws_that_were_shoved_forward_wait_for_their_ramp(mount: str) -> None:
    """They stand for so long, but nothing holds them back."""
    world, client = ready(mount)
    number = client.send("motion.grasp", until="verdict", speed_mm_s=50.0)
    world.run(0.2)
    world.gripper.push(4.0 * world.gripper.parameters.close_sign)
    world.run(0.06)
    world.gripper.push(0.0)
    assert client.wait(number)["result"]["outcome"] == "no_object"


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("force_n", [1.0, 2.0, 5.0, 10.0])
@pytest.mark.parametrize("stiffness_nm_rad", [100.0, 250.0, 1500.0])
def test_what_is_felt_is_nine_tenths_of_the_force_and_the_impact(
    mount: str, force_n: float, stiffness_nm_rad: float
) -> None:
    """Or a little more than the friction, 2.7 N, where that is more."""
    world, client = ready(mount)
    world.gripper.put_object(
        width_mm=WIDTH_MM, stiffness_nm_rad=stiffness_nm_rad, damping_nm_s_rad=0.05
    )
    number = client.send("motion.grasp", until="verdict", force_n=force_n, speed_mm_s=150.0)
    felt_nm = met_rad_s = 0.0
    while not client.has_answer(number):
        began_s = world.now_s
        for part in range(1, 10):
            world.gripper.advance(began_s + part * world.period_s / 10.0)
            felt_nm = max(felt_nm, world.gripper.clamp_nm)
            if felt_nm == 0.0:
                met_rad_s = abs(world.gripper.velocity_rad_s)
        world.tick()
        felt_nm = max(felt_nm, world.gripper.clamp_nm)
    result = client.answers[number]["result"]
    assert result["outcome"] == "object_held"
    assert result["width_mm"] == pytest.approx(WIDTH_MM, abs=0.6)
    assert met_rad_s < 1.2 * result["speed_mm_s"] / 52.69
    impact_nm = met_rad_s * math.sqrt(1.85e-3 * stiffness_nm_rad)
    assert felt_nm < max(0.09 * force_n, 0.27) + impact_nm + 0.05


def test_an_object_that_the_jaws_touch_already_is_found_without_letting_go() -> None:
    world, client = ready("normal", initial_opening_mm=WIDTH_MM)
    world.gripper.put_object(width_mm=WIDTH_MM)
    assert grasp(world, client, force_n=2.0)["outcome"] == "object_held"
    assert world.gripper.clamp_nm > 0.1
