"""The SDK's section "Trajectory record and replay": its sentences about replay."""

import itertools
from pathlib import Path

import pytest

from litegrip_client import (
    CommandError,
    LiteGrip,
    Trajectory,
)
from tests.drop_in import Daemon, Site
from tests.geometry import TRAVEL_MM
from tests.sdk.readme.scenes import jaws_are_loose
from tests.sdk.readme.trajectories import swing


def test_play_blocks_until_the_end_and_a_loop_is_refused(site: Site, gripper: LiteGrip) -> None:
    gripper.goto_openness(0.5)
    began_s = site.now_s
    result = gripper.play(swing())
    assert result
    assert site.now_s - began_s == pytest.approx(2.1, abs=0.2)
    began_s = site.now_s
    assert gripper.play(swing(), speed=2.0)
    assert site.now_s - began_s == pytest.approx(1.1, abs=0.2)
    with pytest.raises(CommandError, match="play_start"):
        gripper.play(swing(), loop=True)
    with pytest.raises(CommandError, match="speed"):
        gripper.play(swing(), speed=0.0)


def test_play_goes_to_the_start_first_or_must_be_there(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto_openness(0.1)
    with site.recorded(daemon) as moments:
        assert gripper.play(swing(), kp=80.0, kd=1.5)
    usual = gripper.config
    gains = [(m.command.kp_nm_rad, m.command.kd_nm_s_rad) for m in moments[9:-1] if m.command]
    assert max(kp for kp, _ in gains) == pytest.approx(80.0, abs=0.2)
    assert max(kd for _, kd in gains) == pytest.approx(1.5, abs=0.01)
    assert (usual.kp, usual.kd) == (100.0, 2.0)  # which are the default's
    jumps = [abs(b.opening_mm - a.opening_mm) for a, b in itertools.pairwise(moments)]
    assert max(jumps) < 2.0
    gripper.goto_openness(0.1)
    with pytest.raises(CommandError, match="align") as caught:
        gripper.play(swing(), align=False)
    assert caught.value.reason == "out_of_limits"
    gripper.goto_openness(0.5)
    assert gripper.play(swing(), align=False)


def test_play_start_replays_in_the_background(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto_openness(0.5)
    status = gripper.play_start(swing())
    assert (status["active"], status["kind"], status["completed"]) == (True, "play", False)
    site.run(0.6)
    assert gripper.trajectory_status()["active"]
    assert daemon.gripper.opening_mm > 0.625 * TRAVEL_MM
    site.run_until(lambda: not gripper.trajectory_status()["active"])
    assert gripper.trajectory_status()["completed"]


def test_play_stop_ends_a_replay_and_leaves_the_gripper_holding(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto_openness(0.5)
    gripper.play_start(swing(), loop=True)
    site.run(5.0)
    status = gripper.play_stop(timeout=1.0)
    assert (status["active"], status["completed"], status["error"]) == (False, False, None)
    where_mm = daemon.gripper.opening_mm
    site.run(1.0)
    assert daemon.gripper.opening_mm == pytest.approx(where_mm, abs=1.0)
    assert (gripper.get_state().mode, daemon.is_energised) == ("holding", True)
    assert not jaws_are_loose(site, daemon)
    assert gripper.play_stop() == status  # there is nothing to be stopped


def test_a_squeeze_repeats_as_a_position_path_and_its_force_is_not_preserved(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=40.0)
    gripper.record_start(zero_gravity=False)
    assert gripper.grasp(force_n=15.0, hold_s=0.5)
    taught = gripper.record_stop()
    assert max(abs(sample.torque_nm) for sample in taught.samples) > 1.2
    daemon.gripper.remove_object()
    gripper.open()
    daemon.gripper.put_object(width_mm=40.0)
    gripper.play(taught)
    site.run(0.5)
    assert daemon.closing_torque_nm < 1.0
    assert gripper.grasp(force_n=15.0, hold_s=0.5)
    assert daemon.closing_torque_nm == pytest.approx(1.5, abs=0.1)


def test_the_force_of_a_squeeze_is_repeated_where_that_is_asked_for(
    site: Site,
    daemon: Daemon,
    gripper: LiteGrip,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beyond the SDK: also from a file, and on an object of another width."""
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path))
    gripper.goto_openness(0.7)
    daemon.gripper.put_object(width_mm=36.0)
    gripper.record_start(zero_gravity=False)
    assert gripper.grasp(8.0, hold_s=1.0)
    assert gripper.goto_openness(0.7)
    taught = gripper.record_stop()
    (grip,) = taught.grips
    assert grip.force_n == 8.0
    assert grip.width_mm == pytest.approx(36.0, abs=1.0)
    taught.save("squeeze")
    daemon.gripper.put_object(width_mm=48.0)
    with site.recorded(daemon) as moments:
        result = gripper.play(Trajectory.load("squeeze"), force="replay")
    assert (result.ok, result.grips) == (True, 1)
    assert result.width_difference_mm == pytest.approx(12.0, abs=1.0)
    squeezes = [abs(m.command.torque_nm) for m in moments if m.command is not None]
    assert sum(abs(squeeze - 0.8) < 0.01 for squeeze in squeezes) > 100
    assert max(squeezes) < 1.1
    daemon.gripper.remove_object()
    assert gripper.play(taught, force="replay").outcome == "no_object"
