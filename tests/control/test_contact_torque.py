"""The true torque of `open` and `close`, from the moment of contact to the end of the move."""

from dataclasses import replace

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.model.motion_config import MOST_PUSH_NM, MotionConfig
from litegripd.sim.plant import MOUNTS
from tests.world import World

TRAVEL_MM, CONFIG = NOMINAL[0].travel_mm, MotionConfig()
FINE_S = 0.0005
MOST, MOST_AT_100_HZ = 1.4, 1.7
"""Of the torque that is allowed there; a control period of 10 ms is long for stiff ends. The same
mm/s are 1.42 times as many rad/s as at 74.8 mm/rad, and twice the kinetic energy: on a very stiff
stop that adds 0.07 times the torque at 100 mm/s."""


def peak_nm(
    world: World,
    kp: float,
    method: str,
    speed_mm_s: float,
    width_mm: float | None,
    k: float,
    kd: float = 2.0,
) -> float:
    """Return the strongest torque towards the end of the move, looked at every 0.5 ms."""
    calibration = world.controller.calibrated.calibration
    assert calibration is not None
    world.controller.use_calibration(replace(calibration, kp_nm_rad=kp, kd_nm_s_rad=kd), None)
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
    return World(
        mount,
        period_s=1.0 / rate_hz,
        initial_opening_mm=opening_mm,
        closed_springback_rad=0.7 / k,
        open_stiffness_nm_rad=k,
    )


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
@pytest.mark.parametrize(
    ("rate_hz", "kp", "speed_mm_s"),
    [
        (200, 100.0, 50.0),
        (1000, 100.0, 100.0),
        (100, 100.0, 50.0),
        (200, 5.0, 50.0),
        (200, 50.0, 50.0),
        (200, 500.0, 50.0),
    ],
)
def test_a_stop_is_met_and_pressed_with_what_is_documented(
    mount: str, method: str, rate_hz: int, kp: float, speed_mm_s: float
) -> None:
    far_mm, near_mm = 0.83 * TRAVEL_MM, 0.17 * TRAVEL_MM
    world = made(mount, rate_hz, far_mm if method == "motion.close" else near_mm, 1500.0)
    documented_nm = CONFIG.stop_nm * (MOST_AT_100_HZ if rate_hz == 100 else MOST)
    peak = peak_nm(world, kp, method, speed_mm_s, None, 1500.0)
    assert 0.9 * CONFIG.stop_nm < peak < documented_nm


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    ("rate_hz", "kp", "speed_mm_s"),
    [(200, 100.0, 50.0), (1000, 50.0, 100.0), (100, 50.0, 50.0), (1000, 100.0, 100.0)],
)
def test_an_object_on_the_way_is_met_with_what_is_documented(
    mount: str, rate_hz: int, kp: float, speed_mm_s: float
) -> None:
    world = made(mount, rate_hz, 0.83 * TRAVEL_MM, 250.0)
    documented_nm = CONFIG.travel_nm
    peak = peak_nm(world, kp, "motion.close", speed_mm_s, 0.5 * TRAVEL_MM, 1500.0)
    assert peak < MOST * documented_nm


@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
@pytest.mark.parametrize("kd", [1.0, 2.0, 5.0])
def test_no_gains_of_a_file_change_how_a_stop_is_met(method: str, kd: float) -> None:
    peaks_nm = []
    for kp in (5.0, 55.0, 200.0, 500.0):
        world = made("normal", 200, 0.5 * TRAVEL_MM, 1500.0)
        peaks_nm.append(peak_nm(world, kp, method, 50.0, None, 1500.0, kd))
    assert peaks_nm == pytest.approx([peaks_nm[0]] * 4, rel=2e-3)


@pytest.mark.parametrize("kp", [5.0, 20.0, 50.0, 500.0])
def test_no_file_pushes_harder_on_the_way_than_what_can_be_let_go_of(kp: float) -> None:
    world = made("normal", 200, 0.83 * TRAVEL_MM, 250.0)
    peak = peak_nm(world, kp, "motion.close", 30.0, 0.5 * TRAVEL_MM, 1500.0)
    assert MOST_PUSH_NM * 0.9 < peak < MOST * MOST_PUSH_NM
