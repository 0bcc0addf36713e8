"""What the motor measures and what lags behind: the speed filter, the current, encoder steps."""

import math
import struct
from dataclasses import replace

import pytest

from litegripd.sim.drive import Drive
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import ENCODER_COUNTS_PER_RAD, Plant, SimulatorParameters
from tests.sim.driving import STATUS, Driver, command

V_BW = 32
ENDLESS = SimulatorParameters(open_rad=-500.0, speed_filter_hz=0.0)


def lag_hz(lag_s: float) -> float:
    """The corner of a first-order filter with this time constant."""
    return 1.0 / (math.tau * lag_s)


def moving(filter_hz: float) -> Driver:
    """A motor without any gain whose jaws move at some 5 rad/s."""
    driver = Driver(SimulatedGripper(replace(ENDLESS, speed_filter_hz=filter_hz)))
    driver.arm()
    driver.gripper.push(-2.0)
    driver.stream(0.005, command())
    driver.gripper.push(-0.25)  # what friction takes at this speed
    driver.stream(0.03, command())
    assert -6.0 < driver.gripper.velocity_rad_s < -4.0
    return driver


@pytest.mark.parametrize("lag_s", [0.5e-3, 1.0e-3, 2.0e-3])
def test_the_reported_speed_answers_a_step_as_a_first_order_filter(lag_s: float) -> None:
    driver = moving(lag_hz(lag_s))
    before_rad_s = driver.ask(STATUS).velocity_rad_s
    driver.gripper.jam()
    driver.wait(lag_s)
    assert driver.gripper.velocity_rad_s == 0.0
    share = driver.ask(STATUS).velocity_rad_s / before_rad_s
    assert share == pytest.approx(math.exp(-1.0), abs=0.01)
    driver.wait(0.05)
    assert driver.ask(STATUS).velocity_rad_s == pytest.approx(0.0, abs=0.015)


def test_without_a_filter_the_reported_speed_is_the_true_one() -> None:
    driver = moving(0.0)
    true_rad_s = driver.gripper.velocity_rad_s
    assert driver.ask(STATUS).velocity_rad_s == pytest.approx(true_rad_s, abs=0.015)
    driver.gripper.jam()
    driver.wait(0.5e-3)
    assert driver.ask(STATUS).velocity_rad_s == pytest.approx(0.0, abs=0.015)


def test_the_filter_is_register_32_and_a_write_counts_at_once() -> None:
    driver = moving(80.0)
    assert driver.read_float(V_BW) == 80.0
    before_rad_s = driver.ask(STATUS).velocity_rad_s
    driver.gripper.jam()
    driver.wait(0.5e-3)
    assert driver.ask(STATUS).velocity_rad_s < 0.7 * before_rad_s
    driver.write(V_BW, 0.0)
    driver.wait(0.25e-3)
    assert driver.ask(STATUS).velocity_rad_s == pytest.approx(0.0, abs=0.015)
    for refused in (-1.0, 500.1, math.nan):
        assert driver.write(V_BW, refused) == struct.pack("<f", 0.0)
    driver.gripper.power_cycle()
    assert driver.read_float(V_BW) == 80.0


def test_a_power_cycle_brings_the_saved_filter_back() -> None:
    driver = moving(0.0)
    driver.write(V_BW, 20.0)
    driver.gripper.power_cycle()
    driver.gripper.jam()
    driver.wait(0.5e-3)
    assert driver.ask(STATUS).velocity_rad_s == pytest.approx(0.0, abs=0.015)


def holding(kd: float, parameters: SimulatorParameters) -> Driver:
    """A motor that presses 20 N on an object with little damping of its own, bumped by a hand."""
    gripper = SimulatedGripper(parameters)
    gripper.put_object(width_mm=50.0, damping_nm_s_rad=0.05)
    driver = Driver(gripper)
    driver.arm()
    driver.stream(0.5, command(kd=0.5, tau=2.0))
    gripper.push(-2.5)
    driver.stream(0.015, command(kd=kd, tau=2.0))
    gripper.push(0.0)
    driver.stream(0.4, command(kd=kd, tau=2.0))
    return driver


def swing_nm(driver: Driver, kd: float) -> float:
    """By how much the motor's torque swings to both sides within 0.1 s."""
    torques = []
    for step in range(400):
        if step % 20 == 0:
            driver.gripper.receive(driver.now_s, command(kd=kd, tau=2.0))
        driver.wait(0.25e-3)
        torques.append(driver.gripper.motor_torque_nm)
    return (max(torques) - min(torques)) / 2.0


@pytest.mark.parametrize(
    ("kd", "lag_s", "inertia", "shakes"),
    [
        (5.0, 0.0, 1.0, False),
        (5.0, 2.0e-3, 1.0, True),
        (3.0, 2.0e-3, 1.0, False),
        (3.0, 2.0e-3, 0.5, True),
        (1.0, 2.0e-3, 0.5, False),
    ],
)
def test_much_damping_shakes_on_a_speed_that_lags(
    kd: float, lag_s: float, inertia: float, shakes: bool
) -> None:
    nominal = SimulatorParameters()
    parameters = replace(
        nominal,
        speed_filter_hz=lag_hz(lag_s) if lag_s else 0.0,
        rotor_inertia_kg_m2=nominal.rotor_inertia_kg_m2 * inertia,
        finger_inertia_kg_m2=nominal.finger_inertia_kg_m2 * inertia,
    )
    found_nm = swing_nm(holding(kd, parameters), kd)
    assert (found_nm > 5.0) if shakes else (found_nm < 0.05), found_nm


def test_shaking_ends_when_the_register_is_written() -> None:
    driver = holding(5.0, SimulatorParameters(speed_filter_hz=80.0))
    assert swing_nm(driver, 5.0) > 5.0
    driver.write(V_BW, 0.0)
    driver.stream(0.3, command(kd=5.0, tau=2.0))
    assert swing_nm(driver, 5.0) < 0.05


@pytest.mark.parametrize("lag_s", [0.0, 0.5e-3, 1.0e-3, 3.0e-3])
def test_the_torque_follows_by_the_lag_of_the_current(lag_s: float) -> None:
    driver = Driver(SimulatedGripper(SimulatorParameters(current_lag_s=lag_s)))
    driver.gripper.jam()
    driver.arm()
    driver.stream(0.05, command())
    before_nm = driver.gripper.motor_torque_nm
    driver.ask(command(tau=4.0))
    driver.wait(max(lag_s, 0.25e-3))
    reached = (driver.gripper.motor_torque_nm - before_nm) / (4.0 - before_nm)
    assert reached == pytest.approx(1.0 - math.exp(-1.0) if lag_s else 1.0, abs=0.01)


@pytest.mark.parametrize("filter_hz", [0.0, 100.0])
def test_the_encoder_counts_in_steps_and_the_speed_comes_from_them(filter_hz: float) -> None:
    parameters = replace(
        ENDLESS, encoder_counts_per_rad=ENCODER_COUNTS_PER_RAD, speed_filter_hz=filter_hz
    )
    plant = Plant(parameters)
    drive = Drive(parameters, plant)
    drive.drive(
        position_rad=0.0, velocity_rad_s=-0.4, kp_nm_rad=0.0, kd_nm_s_rad=1.0, torque_nm=-0.15
    )
    drive.run(1000)
    speeds, positions = [], []
    for _ in range(400):
        drive.run(1)
        speeds.append(drive.measured_velocity_rad_s)
        positions.append(drive.measured_position_rad)
        assert (
            abs(drive.measured_position_rad - parameters.closed_rad - plant.angle_rad)
            < 1.0 / ENCODER_COUNTS_PER_RAD
        )
    counts = [(p - positions[0]) * ENCODER_COUNTS_PER_RAD for p in positions]
    assert counts == pytest.approx([round(count) for count in counts], abs=1e-6)
    assert sum(speeds) / len(speeds) == pytest.approx(plant.speed_rad_s, abs=0.01)
    spread_rad_s = max(speeds) - min(speeds)
    # One count in one step of 0.25 ms is 0.153 rad/s; a filter of 1.6 ms leaves a tenth of it.
    if filter_hz:
        assert 0.005 < spread_rad_s < 0.05
    else:
        assert spread_rad_s == pytest.approx(4000.0 / ENCODER_COUNTS_PER_RAD, rel=1e-6)


def test_the_motor_reports_and_follows_the_counted_position() -> None:
    coarse = replace(SimulatorParameters(), encoder_counts_per_rad=50.0)
    driver = Driver(SimulatedGripper(coarse))
    driver.arm()
    target_rad = driver.gripper.position_rad - 0.105
    driver.stream(1.0, command(q=target_rad, kp=100.0, kd=1.0))
    reported_rad = driver.ask(STATUS).position_rad
    counts = (reported_rad - coarse.closed_rad) * 50.0
    assert counts == pytest.approx(round(counts), abs=0.02)
    assert abs(reported_rad - driver.gripper.position_rad) < 0.02


@pytest.mark.parametrize("change", [{"speed_filter_hz": 60.0}, {"encoder_counts_per_rad": 3000.0}])
def test_slicing_time_changes_nothing_and_rest_is_a_true_rest(change: dict[str, float]) -> None:
    parameters = replace(SimulatorParameters(), speed_filter_hz=200.0)
    parameters = replace(parameters, **change)  # type: ignore[arg-type]
    plants = Plant(parameters), Plant(parameters)
    at_once, sliced = (Drive(parameters, plant) for plant in plants)
    for drive in (at_once, sliced):
        drive.drive(
            position_rad=-0.65, velocity_rad_s=0.0, kp_nm_rad=80.0, kd_nm_s_rad=0.5, torque_nm=0.1
        )
    for done in range(8000):
        sliced.run(1)
        if done % 1000 == 999:
            at_once.run(1000)
            assert plants[0].angle_rad == plants[1].angle_rad
            assert at_once.measured_velocity_rad_s == sliced.measured_velocity_rad_s
            assert at_once.motor_torque_nm == sliced.motor_torque_nm
    assert at_once.measured_velocity_rad_s == plants[0].speed_rad_s == 0.0


def test_the_parameters_are_bounded() -> None:
    with pytest.raises(ValueError, match="speed_filter_hz must be at most 500"):
        SimulatorParameters(speed_filter_hz=501.0)
    with pytest.raises(ValueError, match="encoder_counts_per_rad must not be negative"):
        SimulatorParameters(encoder_counts_per_rad=-1.0)
