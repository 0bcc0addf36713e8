"""The SDK's section "Results"."""

from dataclasses import fields, is_dataclass

import pytest

from litegrip_client import EnableResult, GraspResult, LiteGrip, MotionConfig, MoveResult
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.drop_in import Daemon, Site

FIELDS = {
    MoveResult: "ok reached stalled state target_rad limit_rad final_cmd_rad steps",
    GraspResult: "ok reached stalled state target_rad force_n cycles",
    EnableResult: "ok state tries",
}


@pytest.mark.parametrize("kind", FIELDS)
def test_the_results_are_dataclasses_with_these_fields_first(kind: type) -> None:
    assert is_dataclass(kind)
    wanted = FIELDS[kind].split()
    assert [one.name for one in fields(kind)][: len(wanted)] == wanted


@pytest.mark.parametrize("guarded", [True, False])
def test_stalling_far_from_the_stop_is_ok_false(
    site: Site, daemon: Daemon, gripper: LiteGrip, guarded: bool
) -> None:
    daemon.gripper.put_object(width_mm=40.0)
    if not guarded:
        gripper.motion_config = MotionConfig(stop_torque_cycles=100)
    with site.recorded(daemon) as moments:
        result = gripper.close()
    assert (result.ok, result.stalled, result.reached) == (False, True, False)
    assert result.protected is guarded
    assert bool(result) is False
    assert min(moment.opening_mm for moment in moments) == pytest.approx(40.0, abs=3.0)


def test_grasp_on_nothing_reaches_its_target_and_is_no_success(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """Where the daemon differs: the SDK goes on to squeeze, here the answer is that it is empty."""
    began_s = site.now_s
    result = gripper.grasp()
    assert (result.reached, result.stalled) == (True, False)
    assert (result.ok, result.outcome, result.cycles) == (False, "no_object", 0)
    assert site.now_s - began_s < 3.0
    site.run(1.0)
    assert abs(daemon.closing_torque_nm) < 0.3


@pytest.mark.parametrize("tolerance", [0.02, 0.001])
def test_on_an_empty_gripper_reached_means_within_the_dead_band_of_the_closing_side(
    site: Site, mount: str, tolerance: float
) -> None:
    """A slow jaw sticks short of its target; a tight tolerance must not count that as reached.

    The motor does not filter its speed: damping by a late speed shakes the jaws free. With a tight
    tolerance they may come loose and then be there, or be past it.
    """
    closed_rad, open_rad = limits_of_mount(mount)
    unit = SimulatorParameters(closed_rad=closed_rad, open_rad=open_rad, speed_filter_hz=0.0)
    daemon = site.add(Daemon(mount=mount, parameters=unit))
    with LiteGrip("can0") as gripper:
        gripper.enable()
        gripper.goto(15.0)
        gripper.motion_config = MotionConfig(reach_tol=tolerance, grasp_speed_mm_s=2.8)
        result = gripper.grasp()
    short_rad = (
        result.target_rad - daemon.gripper.position_rad
    ) * daemon.gripper.parameters.close_sign
    assert result.reached is (abs(short_rad) <= tolerance)
    assert result.stalled is not result.reached
    if tolerance == 0.02:
        assert 0.003 < short_rad < 0.012
