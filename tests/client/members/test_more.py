"""Calibrating and teleoperation as the SDK's scripts call them: by position and by keyword."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from litegrip_client import (
    CalibrationData,
    CommandError,
    LiteGrip,
)
from tests.drop_in import Daemon, Site

PROBES: dict[str, Callable[[LiteGrip], CalibrationData]] = {
    "by position": lambda g: g.calibrate(15.0, 1.5, 0.04, 0.002, 6, 150, 1.5),
    "by keyword": lambda g: g.calibrate(
        kp=15.0,
        kd=1.5,
        step_rad=0.04,
        stall_delta=0.002,
        stall_cycles=6,
        max_iter=150,
        tau_limit=1.5,
    ),
    "guided": lambda g: g.calibrate_guided(15.0, 1.5, 0.04, 0.002, 6, 150, 1.5),
}


@pytest.mark.parametrize("probe", PROBES)
def test_the_travel_is_probed_with_the_gains_and_the_torque_that_are_given(
    site: Site, daemon: Daemon, gripper: LiteGrip, probe: str
) -> None:
    with site.recorded(daemon) as moments:
        data = PROBES[probe](gripper)
    assert (data.mount, data.calibrated) == (daemon.mount, True)
    assert data.travel_range == pytest.approx(1.605, abs=0.06)
    probing = [moment.command for moment in moments[20:200] if moment.command is not None]
    assert len(probing) > 100
    assert {round(command.kp_nm_rad) for command in probing} == {15}
    assert max(abs(moment.closing_torque_nm) for moment in moments[20:200]) < 1.6


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


@pytest.mark.parametrize(
    "refused",
    [
        lambda g: g.teleop_start("slave", "10.0.0.1", lead_cap_mm=-1.0),
        lambda g: g.teleop_start("slave", "10.0.0.1", transport=object()),
        lambda g: g.teleop_start("slave", "10.0.0.1", only_from="10.0.0.1"),
    ],
)
def test_what_a_follower_cannot_do_is_refused(
    gripper: LiteGrip, refused: Callable[[LiteGrip], object]
) -> None:
    with pytest.raises(CommandError):
        refused(gripper)
    assert gripper.teleop_status()["active"] is False


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
