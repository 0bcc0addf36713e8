"""The true torque of `open` and `close`, from the moment of contact to the end of the move."""

from dataclasses import replace

import pytest

from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.world import World

MOUNTS = ("normal", "reverse")
MM_RAD = 74.8
FINE_S = 0.0005
MOST, MOST_AT_100_HZ = 1.3, 1.7
"""Of kp times the lead that is allowed there; a control period of 10 ms is long for stiff ends."""


def peak_nm(
    world: World, kp: float, method: str, speed_mm_s: float, width_mm: float | None, k: float
) -> float:
    """Return the strongest torque towards the end of the move, looked at every 0.5 ms."""
    calibration = world.controller.calibrated.calibration
    assert calibration is not None
    world.controller.use_calibration(replace(calibration, kp_nm_rad=kp, kd_nm_s_rad=2.0), None)
    client = world.enabled()
    if width_mm is not None:
        world.gripper.put_object(width_mm=width_mm, stiffness_nm_rad=k)
    sign = world.gripper.parameters.close_sign * (1 if method == "motion.close" else -1)
    number, strongest_nm = client.send(method, speed_mm_s=speed_mm_s), 0.0
    while not client.has_answer(number):
        for part in range(1, round(world.period_s / FINE_S)):
            world.gripper.advance(world.now_s + part * FINE_S)
            strongest_nm = max(strongest_nm, sign * world.gripper.motor_torque_nm)
        world.tick()
        strongest_nm = max(strongest_nm, sign * world.gripper.motor_torque_nm)
    return strongest_nm


def made(mount: str, rate_hz: int, opening_mm: float, k: float) -> World:
    closed_rad, open_rad = limits_of_mount(mount)
    parameters = SimulatorParameters(
        closed_rad=closed_rad,
        open_rad=open_rad,
        initial_opening_mm=opening_mm,
        closed_springback_rad=0.7 / k,
        open_stiffness_nm_rad=k,
    )
    return World(mount, parameters=parameters, period_s=1.0 / rate_hz)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
@pytest.mark.parametrize(
    ("rate_hz", "kp", "speed_mm_s"),
    [(200, 100.0, 50.0), (1000, 100.0, 100.0), (100, 100.0, 50.0), (200, 50.0, 50.0)],
)
def test_a_stop_is_met_and_pressed_with_what_is_documented(
    mount: str, method: str, rate_hz: int, kp: float, speed_mm_s: float
) -> None:
    world = made(mount, rate_hz, 100.0 if method == "motion.close" else 20.0, 1500.0)
    documented_nm = kp * 0.7 / MM_RAD * (MOST_AT_100_HZ if rate_hz == 100 else MOST)
    assert peak_nm(world, kp, method, speed_mm_s, None, 1500.0) < documented_nm


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    ("rate_hz", "kp", "speed_mm_s"),
    [(200, 100.0, 50.0), (1000, 50.0, 100.0), (100, 50.0, 50.0), (1000, 100.0, 100.0)],
)
def test_an_object_on_the_way_is_met_with_what_is_documented(
    mount: str, rate_hz: int, kp: float, speed_mm_s: float
) -> None:
    world = made(mount, rate_hz, 100.0, 250.0)
    documented_nm = kp * 4.0 / MM_RAD
    assert peak_nm(world, kp, "motion.close", speed_mm_s, 60.0, 1500.0) < MOST * documented_nm
