"""Calibrating and teleoperation on both mounts, as the SDK's scripts call them."""

import math
from itertools import pairwise

import pytest

from litegrip_client import (
    CalibrationData,
    LiteGrip,
    TeleopBusyError,
    TrajectoryBusyError,
)
from tests.drop_in import Daemon, Site


def test_the_travel_is_probed_with_the_gains_and_the_torque_that_are_given(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    with site.recorded(daemon) as moments:
        data = gripper.calibrate(15.0, 1.5, 0.04, 0.002, 6, 150, 1.5)
    assert (data.mount, data.calibrated) == (daemon.mount, True)
    assert data.travel_range == pytest.approx(1.605, abs=0.06)
    probing = [moment.command for moment in moments[20:200] if moment.command is not None]
    assert len(probing) > 100
    assert {round(command.kp_nm_rad) for command in probing} == {15}
    assert max(abs(moment.closing_torque_nm) for moment in moments[20:200]) < 1.6


def test_teleoperation_and_trajectories_exclude_each_other(gripper: LiteGrip) -> None:
    gripper.record_start()
    with pytest.raises((TeleopBusyError, TrajectoryBusyError)):
        gripper.teleop_start("slave", fake_leader=True)
    gripper.record_stop()
    gripper.teleop_start("slave", fake_leader=True, align=True, align_speed_mm_s=30.0)
    with pytest.raises(TeleopBusyError):
        gripper.record(1.0)
    with pytest.raises(TeleopBusyError):
        gripper.open()
    status = gripper.teleop_stop(timeout=2.0)
    assert status["active"] is False
    assert math.isfinite(status["torque_nm"])  # it is printed as a number, and written as JSON


@pytest.mark.parametrize("speed", [15.0, 30.0, 60.0])
def test_a_follower_aligns_at_the_speed_that_it_is_given(
    site: Site, daemon: Daemon, gripper: LiteGrip, speed: float
) -> None:
    """The fake leader begins open; the jaws are at 20 mm."""
    gripper.goto(20.0)
    with site.recorded(daemon) as moments:
        gripper.teleop_start("slave", fake_leader=True, align_speed_mm_s=speed)
        site.run(0.7)
    travelled_mm = moments[-1].opening_mm - moments[-41].opening_mm
    assert travelled_mm / 0.2 == pytest.approx(speed, rel=0.15)


def test_without_aligning_a_follower_goes_there_at_once_and_does_not_jump(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto(60.0)
    with site.recorded(daemon) as moments:
        gripper.teleop_start("slave", fake_leader=True, align=False, align_speed_mm_s=5.0)
        site.run(0.8)
    openings = [moment.opening_mm for moment in moments]
    assert openings[-1] - openings[0] > 10.0  # and not 4, at 5 mm/s
    steps = [abs(later - earlier) for earlier, later in pairwise(openings)]
    assert max(steps) < 1.0


def test_a_calibration_that_a_script_has_made_is_used(daemon: Daemon, gripper: LiteGrip) -> None:
    present = gripper.config
    assert present.pos_closed_rad is not None
    assert present.pos_open_rad is not None
    mine = CalibrationData(
        zero_position_rad=present.pos_closed_rad,
        max_position_rad=present.pos_open_rad,
        travel_range_rad=abs(present.pos_closed_rad - present.pos_open_rad),
        rad_to_mm=55.0,
        kp=90.0,
        kd=1.8,
    )
    assert gripper.use_calibration(mine) is True
    now = gripper.config
    assert (now.rad_to_mm, now.kp, now.kd, now.mount) == (55.0, 90.0, 1.8, daemon.mount)
