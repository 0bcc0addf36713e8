"""The SDK's section "Torque, force and safety"."""

from dataclasses import replace
from pathlib import Path

import pytest

from litegrip_client import CommandError, LiteGrip, MotionConfig, UnitConversion
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.drop_in import Daemon, Site
from tests.geometry import MM_RAD, TRAVEL_MM
from tests.sdk.readme.scenes import (
    CODE_RAD,
    LEAD_MM_RAD,
    content,
    jaws_are_loose,
    lead_mm,
    load_content,
    speed_mm_s,
    tuned,
    write_file,
)

TIGHT = SimulatorParameters(
    breakaway_nm=1.2,
    coulomb_nm=1.15,
    close_stick_nm=1.25,
    closed_springback_press_nm=3.0,
    press_torque_nm=1.3,
)
"""A gripper with so much friction that 0.94 N·m do not move it."""


def mounted(parameters: SimulatorParameters, mount: str) -> SimulatorParameters:
    closed_rad, open_rad = limits_of_mount(mount)
    return replace(parameters, closed_rad=closed_rad, open_rad=open_rad)


def test_a_newton_counts_as_a_tenth_of_a_newton_metre_each_time(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    assert UnitConversion.N_TO_NM == 0.1
    assert UnitConversion.n_to_nm(20.0) == pytest.approx(2.0)
    for force_n in (5.0, 12.0, 12.0, 12.0, 25.0):
        gripper.goto(60.0)
        daemon.gripper.put_object(width_mm=30.0)
        gripper.grasp(force_n=force_n, hold_s=2.0)
        expected_nm = UnitConversion.n_to_nm(force_n)
        assert daemon.closing_torque_nm == pytest.approx(expected_nm, abs=0.03)
        daemon.gripper.remove_object()


def test_the_default_force_is_2_nm_of_feed_forward_inside_the_rating_of_3(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    assert gripper.grasp(hold_s=2.0).force_n == 20.0
    command = daemon.commands_since(site.now_s)[-1][1]
    assert command.torque_nm * daemon.gripper.parameters.close_sign == pytest.approx(2.0, abs=0.01)
    assert 1.9 < daemon.closing_torque_nm < 2.1 < 3.0
    with pytest.raises(CommandError):
        gripper.grasp(force_n=40.5, hold_s=1.0)  # more than the fingers are rated for
    assert gripper.grasp(force_n=40.0, hold_s=1.0).force_n == 40.0


@pytest.mark.parametrize("config", [{}, {"max_lead_mm": 6.0, "press_overshoot": 0.2}])
def test_a_lead_that_asks_for_5_or_8_nm_gets_2_of_the_10_by_protocol(
    site: Site, daemon: Daemon, gripper: LiteGrip, config: dict[str, float]
) -> None:
    """Where the daemon differs, from the SDK's 5: what lets go of the jaws must not throw them."""
    assert gripper.info()["registers"]["TMAX"] == 10.0
    daemon.gripper.put_object(width_mm=40.0, stiffness_nm_rad=2000.0)
    gripper.motion_config = tuned(stall_cycles=60, stop_torque_cycles=100, **config)
    with site.recorded(daemon) as moments:
        assert not gripper.close()
    torques_nm = [moment.closing_torque_nm for moment in moments]
    assert 2.0 < max(torques_nm) < 3.0  # a rigid thing stops the rotor, too
    assert torques_nm[-5] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("defect", ["never calibrated", "equal limits"])
def test_what_would_make_every_direction_a_guess_is_rejected(
    site: Site, home: Path, mount: str, defect: str
) -> None:
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    file = home / "any.json"
    with LiteGrip("can0") as gripper:
        gripper.enable()
        if defect == "equal limits":
            write_file(file, mount, zero_position_rad=0.1, max_position_rad=0.1)
            with pytest.raises(CommandError, match="equal"):
                gripper.load_calibration(file)
        else:
            gripper.load_calibration(write_file(file, mount, calibrated=False))
        for move in (gripper.open, gripper.close, gripper.grasp):
            with pytest.raises(CommandError) as caught:
                move()
            assert caught.value.reason == "not_calibrated"
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)


def test_a_cap_below_one_frame_of_travel_is_raised_instead_of_clipping_the_ramp(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """Where the daemon differs: the longer lead is as much softer, and presses no harder."""
    gripper.motion_config = MotionConfig(stop_lead_mm=0.24)
    with site.recorded(daemon) as moments:
        gripper.close()
    assert speed_mm_s(moments, 55.0, 15.0) == pytest.approx(50.0, rel=0.05)
    assert daemon.gripper.opening_mm < 5.0
    near = [m for m in moments if m.opening_mm < 2.3]
    leads_nm = [m.command.kp_nm_rad * lead_mm(m) / LEAD_MM_RAD for m in near if m.command]
    assert max(leads_nm) < 1.1 * 100.0 * 0.24 / LEAD_MM_RAD + 100.0 * CODE_RAD


@pytest.mark.parametrize("action", ["open", "close"])
def test_jaws_that_do_not_press_home_say_so_and_do_with_a_larger_stop_lead(
    site: Site, mount: str, action: str
) -> None:
    daemon = site.add(Daemon(mount=mount, parameters=mounted(TIGHT, mount)))
    short_mm = []
    with LiteGrip("can0") as gripper:
        gripper.enable()
        for stop_lead_mm in (None, 1.0):
            if stop_lead_mm is not None:
                gripper.motion_config.stop_lead_mm = stop_lead_mm
            result = gripper.open() if action == "open" else gripper.close()
            assert result.ok is (stop_lead_mm is not None)
            opening_mm = daemon.gripper.opening_mm
            short_mm.append(opening_mm if action == "close" else TRAVEL_MM - opening_mm)
    assert short_mm[0] > 0.02 * MM_RAD - 0.1  # further than stop_tol
    assert short_mm[1] < 0.5


def test_back_to_back_pressing_heats_the_coil(site: Site, mount: str) -> None:
    """With a coil that warms up 20 times faster than the real one."""
    parameters = mounted(SimulatorParameters(winding_time_s=3.0), mount)
    daemon = site.add(Daemon(mount=mount, parameters=parameters))
    with LiteGrip("can0") as gripper:
        gripper.enable()
        before_c = gripper.get_state().coil_temperature_c
        gripper.motion_config = MotionConfig(settle_s=2.0)
        for _ in range(3):
            gripper.close()
        after_c = gripper.get_state().coil_temperature_c
        site.run(10.0)
        rested_c = gripper.get_state().coil_temperature_c
    assert before_c == 25
    assert daemon.gripper.motor.coil_c < 27.5
    assert after_c is not None
    assert rested_c is not None
    assert after_c >= 27
    assert rested_c < after_c


@pytest.mark.parametrize("during", ["a hold", "a motion", "a grasp"])
@pytest.mark.parametrize("disable", [True, False])
def test_a_crashed_process_does_not_leave_the_motor_holding_torque_unless_it_said_so(
    site: Site, daemon: Daemon, disable: bool, during: str
) -> None:
    """With `disable_on_disconnect=False` the daemon keeps the gripper under control."""
    daemon.gripper.put_object(width_mm=30.0)
    gripper = LiteGrip("can0", disable_on_disconnect=disable)
    gripper.connect()
    gripper.enable()
    if during == "a grasp":
        assert gripper.grasp(hold_s=1.0)
    held_nm = daemon.closing_torque_nm

    def crash() -> None:
        site.kill(gripper)
        raise SystemExit

    if during == "a motion":
        site.when(lambda: daemon.gripper.opening_mm > 80.0, crash)
        with pytest.raises(SystemExit):
            gripper.open()
    else:
        site.kill(gripper)
    site.run(0.1 if disable else 2.0)
    assert daemon.is_energised is not disable
    if disable:
        assert daemon.gripper.motor_torque_nm == 0.0
        assert jaws_are_loose(site, daemon)
    elif during == "a grasp":
        assert daemon.closing_torque_nm >= held_nm - 0.1 > 1.0
    else:
        left_mm = 82.0 if during == "a motion" else 60.0
        assert daemon.gripper.opening_mm == pytest.approx(left_mm, abs=3.0)
        assert not jaws_are_loose(site, daemon)


@pytest.mark.parametrize("file", [{"rad_to_mm": 58.0}, {"kp": 80.0}, {"kp": 5.0}, {"kp": 300.0}])
def test_neither_scale_nor_gains_of_a_file_decide_how_hard_a_stop_is_pressed(
    site: Site, mount: str, file: dict[str, float]
) -> None:
    """Where the daemon differs: the SDK presses with kp x stop_lead_mm / rad_to_mm of the file."""
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        load_content(gripper, {**content(mount), **file})
        gripper.enable()
        with site.recorded(daemon) as moments:
            assert gripper.open()
    assert moments[-5].closing_torque_nm == pytest.approx(-100.0 * 0.7 / LEAD_MM_RAD, abs=0.08)
