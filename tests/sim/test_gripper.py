"""The simulation as a whole: repeatable, independent of how time is sliced, and cheap at rest."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from litegripd.model.calibration import NOMINAL
from litegripd.sim.drive import Drive
from litegripd.sim.gripper import SimulatedGripper, build_gripper
from litegripd.sim.plant import Plant
from tests.sim.driving import ENABLE, Driver, command


def sweep(gripper: SimulatedGripper) -> list[bytes]:
    """Sweep the jaws to and fro onto an object; return every feedback frame."""
    answers = []
    gripper.receive(0.0, command())
    gripper.receive(0.0, ENABLE)
    for period in range(300):
        now_s = period * 0.005
        frame = command(q=-0.7 + 0.5 * math.sin(5.0 * now_s), kp=100.0, kd=2.0)
        answers += [answer.data for answer in gripper.receive(now_s, frame)]
    return answers


def test_the_same_seed_gives_the_same_frames_and_another_seed_others() -> None:
    first, again, other = (sweep(build_gripper(object_mm=40.0, seed=s)) for s in (7, 7, 8))
    assert first == again
    assert first != other


def test_without_a_seed_the_reports_are_exact_and_with_one_they_are_off_by_one_code() -> None:
    exact, noisy = (
        sweep(build_gripper(object_mm=40.0)),
        sweep(build_gripper(object_mm=40.0, seed=1)),
    )
    assert exact == sweep(build_gripper(object_mm=40.0))
    off = set()
    for clean, rough in zip(exact, noisy, strict=True):
        off.add(int.from_bytes(rough[1:3], "big") - int.from_bytes(clean[1:3], "big"))
    assert off == {-1, 0, 1}


@given(st.lists(st.floats(1e-5, 0.05), min_size=1, max_size=40))
@settings(max_examples=60, deadline=None)
def test_slicing_time_differently_changes_nothing(slices: list[float]) -> None:
    at_once, sliced = (Driver(build_gripper(object_mm=40.0)) for _ in range(2))
    for driver in (at_once, sliced):
        driver.write(9, 0)
        driver.ask(command(q=0.1, dq=1.0, kp=30.0, kd=0.5, tau=0.5))
        driver.ask(ENABLE)
    now_s = 0.0
    for duration_s in slices:
        now_s += duration_s
        sliced.gripper.advance(now_s)
    at_once.gripper.advance(now_s)
    at_once.now_s = sliced.now_s = now_s
    assert at_once.gripper.position_rad == sliced.gripper.position_rad
    assert at_once.gripper.velocity_rad_s == sliced.gripper.velocity_rad_s
    assert at_once.gripper.motor_torque_nm == sliced.gripper.motor_torque_nm
    assert at_once.gripper.motor.coil_c == sliced.gripper.motor.coil_c
    assert at_once.ask(command()) == sliced.ask(command())


def test_slicing_time_does_not_move_the_watchdog() -> None:
    positions = []
    for slice_s in (0.0003, 0.005, 0.5):
        driver = Driver()
        driver.ask(command(q=-0.6, dq=0.3, kp=20.0, kd=1.0))
        driver.ask(ENABLE)
        for _ in range(math.ceil(0.5 / slice_s)):
            driver.wait(slice_s)
        assert driver.gripper.motor.status == 0xD
        positions.append(driver.gripper.position_rad)
    assert positions[0] == positions[1] == positions[2]


def test_the_shortcut_at_rest_takes_the_same_course_as_single_steps() -> None:
    parameters = SimulatedGripper().parameters
    plants = Plant(parameters), Plant(parameters)
    skipping, stepping = (Drive(parameters, plant) for plant in plants)
    for drive in (skipping, stepping):
        drive.drive(
            position_rad=-0.65, velocity_rad_s=0.0, kp_nm_rad=80.0, kd_nm_s_rad=1.5, torque_nm=0.1
        )
    skipping.run(4000)
    for _ in range(4000):
        stepping.run(1)
    assert plants[0].speed_rad_s == plants[1].speed_rad_s == 0.0
    assert plants[0].angle_rad == plants[1].angle_rad
    assert skipping.measured_torque_nm == stepping.measured_torque_nm
    assert skipping.take_mean_square_torque(1.0) == pytest.approx(
        stepping.take_mean_square_torque(1.0), abs=1e-12
    )


def test_an_object_wider_than_the_start_opens_the_jaws_further() -> None:
    assert build_gripper().opening_mm == pytest.approx(60.0)
    assert build_gripper(object_mm=70.0).opening_mm == pytest.approx(80.0)
    assert build_gripper(object_mm=80.0).opening_mm == pytest.approx(NOMINAL[0].travel_mm)
    with pytest.raises(ValueError, match="less than 87 mm wide"):
        build_gripper(object_mm=88.0)
    with pytest.raises(ValueError, match="mount must be one of normal, reverse"):
        build_gripper(mount="sideways")
