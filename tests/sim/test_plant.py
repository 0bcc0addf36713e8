"""The mechanics, seen through the motor as a driver sees them."""

import math
from dataclasses import replace

import pytest

from litegripd.sim.gripper import SimulatedGripper, build_gripper
from litegripd.sim.plant import GrippedObject, SimulatorParameters, limits_of_mount
from tests.sim.driving import DISABLE, Driver, command

USUAL = SimulatorParameters()
MM_PER_RAD = USUAL.rad_to_mm
TRAVEL_MM = abs(USUAL.open_rad - USUAL.closed_rad) * MM_PER_RAD


def armed(gripper: SimulatedGripper | None = None) -> Driver:
    driver = Driver(gripper)
    driver.arm()
    return driver


def at_opening(opening_mm: float) -> SimulatedGripper:
    return SimulatedGripper(SimulatorParameters(initial_opening_mm=opening_mm))


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_pressed_against_an_end_the_jaws_stand_at_the_calibrated_limit(mount: str) -> None:
    closed_rad, open_rad = limits_of_mount(mount)
    driver = armed(build_gripper(mount=mount))
    sign = driver.gripper.parameters.close_sign
    assert sign == (1 if mount == "normal" else -1)
    driver.stream(4.0, command(kd=1.0, tau=sign * 0.94))
    assert driver.gripper.position_rad == pytest.approx(closed_rad, abs=0.002)
    assert driver.gripper.opening_mm == pytest.approx(0.0, abs=0.15)
    driver.stream(4.0, command(kd=1.0, tau=-sign * 0.94))
    assert driver.gripper.position_rad == pytest.approx(open_rad, abs=0.002)
    assert driver.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=0.3)


def test_both_mounts_are_mirror_images() -> None:
    # Zero torque has no code of its own, so the mirror needs codes that mirror exactly.
    normal, reverse = armed(build_gripper(mount="normal")), armed(build_gripper(mount="reverse"))
    for driver, torque_nm in ((normal, 1.0), (reverse, -1.0)):
        driver.ask(DISABLE)
        driver.gripper.push(torque_nm)
        driver.wait(0.5)
    assert normal.gripper.opening_mm == pytest.approx(reverse.gripper.opening_mm, abs=1e-9)
    assert normal.gripper.velocity_rad_s == pytest.approx(-reverse.gripper.velocity_rad_s)


def test_the_soft_closed_end_springs_back_after_a_press() -> None:
    driver = armed(at_opening(10.0))
    driver.stream(2.0, command(kd=1.0, tau=1.0))
    pressed_rad = driver.gripper.position_rad
    driver.ask(DISABLE)
    driver.wait(1.0)
    assert pressed_rad - driver.gripper.position_rad == pytest.approx(0.0275, abs=0.0015)
    assert driver.gripper.velocity_rad_s == 0.0


def test_the_open_end_is_stiff() -> None:
    driver = armed(at_opening(110.0))
    driver.stream(2.0, command(kd=1.0, tau=-1.0))
    light_rad = driver.gripper.position_rad
    driver.stream(2.0, command(kd=1.0, tau=-3.0))
    assert light_rad - driver.gripper.position_rad == pytest.approx(2.0 / 250.0, abs=0.0005)


def test_standing_jaws_hold_against_a_push_below_the_breakaway() -> None:
    driver = Driver()
    start_rad = driver.gripper.position_rad
    driver.gripper.push(0.20)
    driver.wait(5.0)
    assert driver.gripper.position_rad == start_rad
    driver.gripper.push(0.22)
    driver.wait(5.0)
    # Moving, only 0.15 N·m of friction is left, and the shorted phases brake.
    assert driver.gripper.velocity_rad_s == pytest.approx((0.22 - 0.15) / 0.72, rel=0.01)


def test_moving_jaws_coast_to_a_true_standstill() -> None:
    driver = armed()
    driver.gripper.push(0.5)
    driver.stream(0.02, command())
    driver.gripper.push(0.0)
    assert driver.gripper.velocity_rad_s > 0.5
    driver.stream(0.5, command())
    assert driver.gripper.velocity_rad_s == 0.0


@pytest.mark.parametrize(
    ("opening_mm", "direction", "dead_band_rad"),
    [(60.0, 1, 0.0021), (60.0, -1, 0.0021), (6.0, 1, 0.0095), (6.0, -1, 0.0021)],
)
def test_the_dead_band_is_wide_only_when_closing_near_the_closed_end(
    opening_mm: float, direction: int, dead_band_rad: float
) -> None:
    for lead_rad, moves in ((dead_band_rad - 0.0006, False), (dead_band_rad + 0.0009, True)):
        driver = armed(at_opening(opening_mm))
        start_rad = driver.gripper.position_rad
        driver.stream(0.5, command(q=start_rad + direction * lead_rad, kp=100.0, kd=2.0))
        assert (driver.gripper.position_rad != start_rad) is moves


def test_slow_closing_near_the_closed_end_sticks_and_slips() -> None:
    driver = armed(at_opening(9.0))
    start_rad, speed_rad_s = driver.gripper.position_rad, 5.0 / MM_PER_RAD
    stops = slips = 0
    moving = False
    for period in range(200):
        target_rad = start_rad + speed_rad_s * period * 0.005
        driver.stream(0.005, command(q=target_rad, dq=speed_rad_s, kp=100.0, kd=2.0))
        now_moving = driver.gripper.velocity_rad_s > 0.0
        stops += moving and not now_moving
        slips += now_moving and not moving
        moving = now_moving
    assert stops >= 3
    assert slips >= 3


def test_disabled_is_not_slack_but_enabled_with_zero_gains_is() -> None:
    braked, free = Driver(), armed()
    for driver in (braked, free):
        driver.gripper.push(0.6)
        driver.wait(0.05)
    assert braked.gripper.velocity_rad_s == pytest.approx(0.45 / 0.72, rel=0.01)
    assert free.gripper.velocity_rad_s > 8.0


def test_an_object_is_held_with_the_torque_that_its_spring_says() -> None:
    driver = armed(build_gripper(object_mm=30.0, object_stiffness_nm_rad=250.0))
    feedback = driver.stream(2.0, command(kd=1.0, tau=2.0))
    squeezed_rad = (30.0 - driver.gripper.opening_mm) / MM_PER_RAD
    assert squeezed_rad * 250.0 == pytest.approx(2.0 - 0.15, abs=0.05)
    assert feedback.torque_nm == pytest.approx(2.0, abs=0.01)


def test_a_removed_object_lets_the_jaws_go_on() -> None:
    driver = armed(build_gripper(object_mm=60.0))
    driver.stream(1.0, command(kd=2.0, tau=1.0))
    assert driver.gripper.opening_mm == pytest.approx(60.0, abs=0.5)
    driver.gripper.remove_object()
    driver.stream(0.2, command(kd=2.0, tau=1.0))
    assert driver.gripper.opening_mm < 56.0


def test_an_object_yields_at_its_own_speed_under_force_alone() -> None:
    driver = armed(at_opening(60.0))
    driver.gripper.put_object(width_mm=50.0, yield_mm_s=3.0, yield_torque_nm=0.5)
    driver.stream(2.0, command(kd=1.0, tau=2.0))
    before_mm = driver.gripper.opening_mm
    driver.stream(2.0, command(kd=1.0, tau=2.0))
    assert before_mm - driver.gripper.opening_mm == pytest.approx(6.0, abs=0.1)
    driver.stream(1.0, command(kd=1.0, tau=0.4))
    before_mm = driver.gripper.opening_mm
    driver.stream(2.0, command(kd=1.0, tau=0.4))
    assert driver.gripper.opening_mm == pytest.approx(before_mm, abs=0.01)


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_an_object_gives_way_at_once_and_feels_what_it_is_pressed_with(mount: str) -> None:
    gripper = build_gripper(mount=mount, object_mm=50.0)
    driver = armed(gripper)
    sign = gripper.parameters.close_sign
    driver.stream(2.0, command(kd=1.0, tau=sign * 2.0))
    before_mm = gripper.opening_mm
    assert gripper.clamp_nm == pytest.approx(2.0 - 0.15, abs=0.05)
    gripper.give_way(1.5)
    assert gripper.clamp_nm == 0.0
    driver.stream(1.0, command(kd=1.0, tau=sign * 2.0))
    assert before_mm - gripper.opening_mm == pytest.approx(1.5, abs=0.05)
    assert gripper.clamp_nm == pytest.approx(2.0 - 0.15, abs=0.05)


@pytest.mark.parametrize("way_mm", [0.0, -1.0, math.nan, math.inf])
def test_a_way_that_no_object_can_give_is_rejected(way_mm: float) -> None:
    gripper = build_gripper(object_mm=50.0)
    with pytest.raises(ValueError, match="way_mm must be"):
        gripper.give_way(way_mm)
    gripper.remove_object()
    assert gripper.clamp_nm == 0.0
    with pytest.raises(ValueError, match="no object between the jaws"):
        gripper.give_way(1.0)


def test_an_object_with_friction_holds_the_jaws_when_they_are_let_go() -> None:
    driver = armed(at_opening(60.0))
    driver.gripper.put_object(width_mm=50.0, friction_nm=3.0)
    driver.stream(2.0, command(kd=1.0, tau=5.0))
    gripped_mm = driver.gripper.opening_mm
    driver.ask(DISABLE)
    driver.wait(1.0)
    assert driver.gripper.opening_mm == pytest.approx(gripped_mm, abs=0.2)


def test_a_vanishing_object_lets_undamped_jaws_jump_and_damping_prevents_it() -> None:
    speeds_rad_s = []
    for kd in (0.0, 2.0):
        driver = armed(build_gripper(object_mm=70.0))
        driver.stream(1.0, command(kd=2.0, tau=2.0))
        driver.gripper.remove_object()
        driver.stream(0.04, command(kd=kd, tau=2.0))
        speeds_rad_s.append(driver.gripper.velocity_rad_s)
    assert speeds_rad_s[0] > 20.05
    assert speeds_rad_s[1] == pytest.approx(0.936, abs=0.067)


def test_the_current_limit_bounds_the_torque_and_the_supply_the_speed() -> None:
    endless = SimulatorParameters(open_rad=-500.0)
    driver = armed(SimulatedGripper(endless))
    driver.stream(0.005, command(tau=-10.0))
    driver.stream(0.010, command(tau=-10.0))
    assert driver.gripper.motor_torque_nm >= -9.6957
    driver.stream(1.0, command(tau=-10.0))
    assert -20.9 < driver.gripper.velocity_rad_s < -19.5
    driver.gripper.set_supply(20.0)
    driver.stream(2.0, command(tau=-10.0))
    assert driver.gripper.velocity_rad_s > -20.9 * 20.0 / 24.0


def test_the_report_of_the_torque_lags_behind_the_torque() -> None:
    driver = armed(build_gripper(object_mm=60.0))
    driver.stream(1.0, command(kd=1.0, tau=1.0))
    driver.ask(command(tau=3.0))
    driver.wait(0.0045)
    # One filter time after the step: 1 - 1/e of it, less what the current loop took.
    lagging_nm = driver.ask(command(tau=3.0)).torque_nm
    assert driver.gripper.motor_torque_nm > 2.9
    assert 1.7 < lagging_nm < 2.3
    driver.wait(0.05)
    assert driver.ask(command(tau=3.0)).torque_nm == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize("opening_mm", [1.0, 6.0, 60.0, TRAVEL_MM - 1.0])
@pytest.mark.parametrize(("kp", "kd"), [(500.0, 5.0), (500.0, 1.0), (0.0, 5.0), (100.0, 2.0)])
def test_every_damped_gain_settles(opening_mm: float, kp: float, kd: float) -> None:
    """With the speed filtered by 1.6 ms, more than 3 N·m·s/rad shakes, as theory has it."""
    unfiltered = SimulatorParameters(initial_opening_mm=opening_mm, speed_filter_hz=0.0)
    driver = armed(SimulatedGripper(unfiltered))
    target_rad = driver.gripper.position_rad
    driver.gripper.push(1.5)
    driver.stream(0.2, command(q=target_rad, kp=kp, kd=kd))
    driver.gripper.push(0.0)
    driver.stream(2.0, command(q=target_rad, kp=kp, kd=kd))
    assert driver.gripper.velocity_rad_s == pytest.approx(0.0, abs=1e-4)
    if kp:
        assert driver.gripper.position_rad == pytest.approx(target_rad, abs=1.0 / kp)


def test_the_extreme_gains_stay_bounded_against_the_stiff_end() -> None:
    driver = armed(at_opening(TRAVEL_MM - 5.0))
    for period in range(400):
        target_rad = -12.5 if period % 40 < 20 else 12.5
        driver.stream(0.005, command(q=target_rad, dq=-30.0, kp=500.0, kd=5.0))
        assert math.isfinite(driver.gripper.position_rad)
        low_rad, high_rad = USUAL.open_rad - 0.109, USUAL.closed_rad + 0.386
        assert low_rad < driver.gripper.position_rad < high_rad


def test_bad_objects_are_refused() -> None:
    gripper = at_opening(20.0)
    with pytest.raises(ValueError, match="does not fit between the jaws"):
        gripper.put_object(width_mm=30.0)
    with pytest.raises(ValueError, match="stiffness_nm_rad must be more than 0"):
        GrippedObject(width_mm=1.0, stiffness_nm_rad=0.0)
    with pytest.raises(ValueError, match="width_mm must be finite"):
        gripper.put_object(width_mm=math.nan)
    with pytest.raises(ValueError, match="torque_nm must be finite"):
        gripper.push(math.inf)
    with pytest.raises(ValueError, match="volts must be finite"):
        gripper.set_supply(-1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"closed_rad": math.nan}, "closed_rad must be a finite number"),
        ({"coulomb_nm": -0.1}, "coulomb_nm must not be negative"),
        ({"rad_to_mm": 0.0}, "rad_to_mm must be more than 0"),
        ({"closed_rad": USUAL.open_rad}, "no travel"),
        ({"can_id": 0x7FF}, "can_id must be 1 to 0x7FE"),
        ({"coulomb_nm": 0.5}, "friction must grow"),
    ],
)
def test_bad_parameters_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(SimulatorParameters(), **change)  # type: ignore[arg-type]
