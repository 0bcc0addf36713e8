"""The SDK's section "Trajectory record and replay"."""

import itertools
import math
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    LiteGrip,
    Trajectory,
    TrajectoryBusyError,
    TrajectorySample,
    list_trajectories,
)
from litegrip_client.ctl.main import main
from litegripd.model.motor import MitCommand, MotorPhase
from tests.drop_in import Daemon, Site
from tests.seed.scenes import bench_unit, content, jaws_are_loose, load_content

CODE_NM = 20.0 / 4095
"""One step of a commanded torque on the bus."""

POINTS_AT = [number / 100 for number in range(201)]


def push(site: Site, daemon: Daemon, *steps: tuple[float, float]) -> None:
    """Have a hand push the jaws: each step is from when on, in s, and with which opening torque."""
    sign = daemon.gripper.parameters.close_sign
    for at_s, opening_nm in steps:
        site.after(at_s, partial(daemon.gripper.push, -opening_nm * sign))


def teach(site: Site, daemon: Daemon) -> None:
    """Have a hand open the jaws for a while, and let go of them."""
    push(site, daemon, (0.2, 0.25), (0.5, 0.0))


def swing(size: float = 0.2, middle: float = 0.5, torque_nm: float = 0.0) -> Trajectory:
    """Return a motion to and fro, of 2 s."""
    samples = [
        TrajectorySample(t, middle + size * math.sin(math.pi * t), 0.0, 0.0, torque_nm)
        for t in POINTS_AT
    ]
    return Trajectory(samples, 100.0, 1.7e9, 0.114, -1.491, 74.8)


def pose(openness: float) -> Trajectory:
    """Return a trajectory of one sample."""
    sample = TrajectorySample(0.0, openness, 0.0, 0.0, 0.0)
    return Trajectory([sample], 100.0, 1.7e9, 0.114, -1.491, 74.8)


def assert_slack(command: MitCommand) -> None:
    """No gain, and no torque but for the step with which zero is coded."""
    assert (command.kp_nm_rad, command.kd_nm_s_rad) == (0.0, 0.0)
    assert abs(command.torque_nm) < CODE_NM


def off_mm(moments: Any, trajectory: Trajectory, begun_s: float, travel_mm: float) -> float:
    """Return how far the jaws were from the path at most, from `begun_s` on."""
    worst = 0.0
    for sample in trajectory.samples:
        at_s = begun_s + sample.t - trajectory.samples[0].t
        moment = min(moments, key=lambda one: abs(one.at_s - at_s))
        worst = max(worst, abs(moment.opening_mm - sample.openness * travel_mm))
    return worst


def test_the_example(site: Site, home: Path, daemon: Daemon) -> None:
    teach(site, daemon)
    began_mm = daemon.gripper.opening_mm
    with LiteGrip("can0") as gripper:
        gripper.load_template(daemon.mount)
        gripper.enable()

        taught = gripper.record(1.0)
        pushed_mm = daemon.gripper.opening_mm
        taught.save("pick")
        gripper.play(taught)

        assert daemon.gripper.opening_mm == pytest.approx(pushed_mm, abs=2.5)
    assert pushed_mm > began_mm + 5.0
    assert (home / ".litegrip" / "trajectories" / "pick.lgt").exists()
    assert Trajectory.load("pick") == taught


def test_a_motion_is_captured_once_and_repeated_later(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    teach(site, daemon)
    with site.recorded(daemon) as first:
        taught = gripper.record(1.0)
    assert len(taught) == 100
    assert taught.longest_gap_s == pytest.approx(0.01, abs=1e-6)
    truth = [moment.opening_mm / 120.0 for moment in first]
    for sample in taught.samples:
        assert min(abs(sample.openness - one) for one in truth) < 0.01
    assert max(s.openness for s in taught.samples) == pytest.approx(max(truth), abs=0.01)
    assert gripper.close()
    with site.recorded(daemon) as again:
        result = gripper.play(taught)
    assert result
    assert (result.outcome, result.loops) == ("completed", 1)
    begun_s = again[-1].at_s
    ended = [off_mm(again, taught, begun_s - 0.005 * shift, 120.0) for shift in range(150, 400)]
    assert min(ended) < 4.0


def test_recording_is_zero_gravity_and_replay_streams_openings_as_mit_frames(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.record_start()
    with site.recorded(daemon) as moments:
        site.run(0.3)
    for moment in moments[2:]:
        command = moment.command
        assert command is not None
        assert_slack(command)
    gripper.record_stop()
    gripper.goto_openness(0.5)
    with site.recorded(daemon) as moments:
        assert gripper.play(swing())
    commands = [moment.command for moment in moments[5:]]
    assert all(command is not None and command.kp_nm_rad > 0.0 for command in commands)
    positions = {command.position_rad for command in commands if command is not None}
    assert len(positions) > 150


def test_what_is_stored_is_the_openness_so_it_replays_on_another_mount_and_calibration(
    site: Site, daemon: Daemon, gripper: LiteGrip, mount: str
) -> None:
    teach(site, daemon)
    taught = gripper.record(1.0)
    config = gripper.config
    assert (taught.mount, taught.rad_to_mm) == (mount, config.rad_to_mm)
    for sample in taught.samples:
        distance_rad = (taught.pos_closed_rad - sample.position_rad) * (config.close_sign or 0)
        travel_rad = abs(taught.pos_open_rad - taught.pos_closed_rad)
        share = min(max(distance_rad / travel_rad, 0.0), 1.0)
        assert sample.openness == pytest.approx(share, abs=1e-9)
    other_mount = "reverse" if mount == "normal" else "normal"
    other = site.add(Daemon("can1", other_mount, parameters=bench_unit(other_mount)))
    with LiteGrip("can1") as second:
        unit = other.gripper.parameters
        limits = {"zero_position_rad": unit.closed_rad, "max_position_rad": unit.open_rad}
        load_content(second, content(other_mount, **limits))
        second.enable()
        assert second.play(taught)
        state = second.get_state()
        assert state.openness == pytest.approx(taught.samples[-1].openness, abs=0.02)
        travel_mm = abs(unit.closed_rad - unit.open_rad) * unit.rad_to_mm
        assert other.gripper.opening_mm / travel_mm == pytest.approx(
            taught.samples[-1].openness, abs=0.02
        )


def test_record_blocks_for_its_time_and_returns_the_trajectory(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    for duration_s, rate_hz, count in ((0.5, 100.0, 50), (0.5, 200.0, 100), (1.0, 20.0, 20)):
        began_s = site.now_s
        taught = gripper.record(duration_s, rate_hz)
        assert site.now_s - began_s == pytest.approx(duration_s, abs=0.06)
        assert isinstance(taught, Trajectory)
        assert (len(taught), taught.sample_hz) == (count, rate_hz)
        assert taught.duration_s == pytest.approx((count - 1) / rate_hz, abs=0.006)
    assert gripper.get_state().mode == "holding"
    assert not jaws_are_loose(site, daemon)


def test_record_start_returns_the_status_and_ends_at_max_samples(
    site: Site, gripper: LiteGrip
) -> None:
    status = gripper.record_start(rate_hz=50.0, max_samples=10)
    assert (status["active"], status["kind"], status["samples"]) == (True, "record", 0)
    site.run(1.0)
    assert (gripper.trajectory_status()["active"], gripper.get_state().mode) == (False, "holding")
    assert len(gripper.record_stop()) == 10


def test_record_stop_returns_what_was_captured(site: Site, gripper: LiteGrip) -> None:
    gripper.record_start()
    site.run(0.25)
    taught = gripper.record_stop()
    assert len(taught) == pytest.approx(25, abs=1)
    assert gripper.get_state().mode == "holding"
    with pytest.raises(CommandError, match="no recording is under way"):
        gripper.record_stop()


def test_a_recording_without_samples_raises_unless_that_is_allowed(gripper: LiteGrip) -> None:
    gripper.record_start()
    with pytest.raises(CommandError, match="no samples") as caught:
        gripper.record_stop()
    assert caught.value.reason == "recording_failed"
    gripper.record_start()
    empty = gripper.record_stop(allow_empty=True)
    assert (len(empty), empty.duration_s) == (0, 0.0)


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
    assert daemon.gripper.opening_mm > 75.0
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


def test_one_status_tells_of_both_directions(site: Site, gripper: LiteGrip) -> None:
    always = {"active", "kind", "samples", "error"}
    status = gripper.trajectory_status()
    assert always <= status.keys()
    assert (status["active"], status["kind"], status["samples"]) == (False, None, 0)
    gripper.record_start()
    site.run(0.5)
    status = gripper.trajectory_status()
    assert always | {"rate_hz", "zero_gravity", "loop_hz"} <= status.keys()
    assert (status["rate_hz"], status["zero_gravity"]) == (100.0, True)
    assert status["loop_hz"] == pytest.approx(100.0, abs=1.0)
    gripper.play(gripper.record_stop())
    status = gripper.trajectory_status()
    assert always | {"frames", "speed", "openness", "completed"} <= status.keys()
    assert (status["active"], status["completed"], status["speed"]) == (False, True, 1.0)
    assert (status["samples"], status["error"]) == (50, None)


def test_the_same_from_the_command_line(
    site: Site, daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    site.run(0.01)
    assert main(["enable"]) == 0
    teach(site, daemon)
    assert main(["record", "pick", "--seconds", "1"]) == 0
    taught_mm = daemon.gripper.opening_mm
    assert main(["close"]) == 0
    capsys.readouterr()
    assert main(["trajectories"]) == 0
    (line,) = capsys.readouterr().out.splitlines()[1:]
    assert line.split()[:4] == ["pick", "100", "0.99", "s"]
    assert main(["play", "pick", "--repeat", "3"]) == 0
    assert daemon.gripper.opening_mm == pytest.approx(taught_mm, abs=2.5)
    assert "3 passes" in capsys.readouterr().out


def test_save_writes_where_the_environment_says_and_a_path_as_written(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory = swing()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("LITEGRIP_TRAJ_DIR", raising=False)
    usual = home / ".litegrip" / "trajectories" / "pick.lgt"
    assert trajectory.save("pick") == str(usual)
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path / "mine"))
    assert trajectory.save("pick") == str(tmp_path / "mine" / "pick.lgt")
    written = tmp_path / "elsewhere" / "pick.bin"
    assert trajectory.save(str(written)) == str(written)
    assert usual.read_bytes() == written.read_bytes()


def test_load_reads_it_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path))
    trajectory = swing(torque_nm=0.25)
    trajectory.save("pick")
    assert Trajectory.load("pick") == trajectory
    with pytest.raises(CommandError, match=r"there is no trajectory .*other\.lgt"):
        Trajectory.load("other")


def test_a_listing_has_one_line_per_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No hardware is needed, and no daemon."""
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path))
    assert list_trajectories() == []
    swing().save("wave")
    pose(0.5).save("pose")
    (tmp_path / "broken.lgt").write_bytes(b"LGRTRJ01")
    names = [line.partition(":")[0] for line in map(str, list_trajectories())]
    assert names == ["broken", "pose", "wave"]
    assert str(list_trajectories()[2]) == "wave: 2.00 s, 201 samples"
    assert main(["trajectories", "--local"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1 + 3


def test_the_format_has_a_magic_header_of_8_bytes(tmp_path: Path) -> None:
    path = Path(swing().save(str(tmp_path / "a.lgt")))
    whole = path.read_bytes()
    assert whole[:8] == b"LGRTRJ01"
    assert len(whole) == 66 + 201 * 40
    path.write_bytes(b"LGRTRJ02" + whole[8:])
    with pytest.raises(CommandError, match=r"no \.lgt file"):
        Trajectory.load(str(path))


@pytest.mark.parametrize("off", [-40, -1, 1, 40])
def test_a_length_that_does_not_match_the_sample_count_is_rejected(
    tmp_path: Path, off: int
) -> None:
    path = Path(swing().save(str(tmp_path / "a.lgt")))
    whole = path.read_bytes()
    path.write_bytes(whole[:off] if off < 0 else whole + bytes(off))
    with pytest.raises(CommandError, match="201 samples make 8106"):
        Trajectory.load(str(path))
    path.write_bytes(whole[:10] + struct.pack("<I", 200) + whole[14:])
    with pytest.raises(CommandError, match="200 samples make 8066"):
        Trajectory.load(str(path))


def test_replay_commands_positions_and_never_the_recorded_torque(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    commands: dict[float, list[tuple[float, float]]] = {}
    for torque_nm in (0.0, 2.5):
        gripper.goto_openness(0.5)
        with site.recorded(daemon) as moments:
            gripper.play(swing(torque_nm=torque_nm))
        sent = [moment.command for moment in moments]
        assert all(command is None or abs(command.torque_nm) < 0.01 for command in sent)
        commands[torque_nm] = [(c.position_rad, c.torque_nm) for c in sent if c is not None]
    assert len(commands[0.0]) == pytest.approx(len(commands[2.5]), abs=5)


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


def test_record_is_exclusive_and_the_jaws_are_slack_for_its_whole_duration(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    refused: list[BaseException] = []

    def drive() -> None:
        with LiteGrip("can0") as another, pytest.raises(BusyError) as caught:
            another.open()
        refused.append(caught.value)

    loose: list[bool] = []
    site.after(0.3, drive)
    push(site, daemon, (0.05, 0.25), (0.15, 0.0), (0.7, 0.25), (0.85, 0.0))
    for at_s in (0.1, 0.75):
        site.after(at_s, lambda: loose.append(abs(daemon.gripper.velocity_rad_s) > 0.05))
    with site.recorded(daemon) as moments:
        gripper.record(1.0)
    assert (len(refused), loose) == (1, [True, True])
    for moment in moments[3:-10]:
        assert moment.command is not None
        assert_slack(moment.command)
    assert not jaws_are_loose(site, daemon)


def test_without_zero_gravity_it_only_reads_while_something_else_drives(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto_openness(0.2)
    status = gripper.record_start(zero_gravity=False)
    assert status["zero_gravity"] is False
    assert not jaws_are_loose(site, daemon)
    assert gripper.goto_openness(0.8, duration=1.0)
    assert gripper.goto_openness(0.3, duration=1.0)
    taught = gripper.record_stop()
    openness = [sample.openness for sample in taught.samples]
    assert openness[0] == pytest.approx(0.2, abs=0.03)
    assert max(openness) == pytest.approx(0.8, abs=0.03)
    assert openness[-1] == pytest.approx(0.3, abs=0.03)
    gripper.close()
    assert gripper.play(taught)
    assert daemon.gripper.opening_mm == pytest.approx(36.0, abs=3.0)


@pytest.mark.parametrize("zero_gravity", [True, False])
def test_a_capture_that_did_not_fill_raises_with_the_number_of_samples(
    site: Site, daemon: Daemon, gripper: LiteGrip, zero_gravity: bool
) -> None:
    site.after(0.5, lambda: daemon.gripper.set_supply(40.0))  # the motor faults
    with pytest.raises(CommandError, match=r"after (49|50|51) samples") as caught:
        gripper.record(2.0, zero_gravity=zero_gravity)
    assert caught.value.reason == "recording_failed"
    assert caught.value.data["samples"] == pytest.approx(50, abs=1)


def test_a_capture_with_too_many_holes_raises(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """Every other measurement is lost."""
    daemon.lose_from_motor = lambda _frame: round(site.now_s / 0.005) % 2 == 0
    with pytest.raises(CommandError, match=r"did not fill: \d+ of 100 samples") as caught:
        gripper.record(0.5, rate_hz=200.0)
    assert caught.value.data["expected"] == 100
    assert caught.value.data["samples"] < 90


def test_a_sampling_that_died_is_never_a_good_capture(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.record_start(zero_gravity=False)
    site.run(0.5)
    gripper.disable()
    site.run(0.1)
    status = gripper.trajectory_status()
    assert status["active"] is False
    assert "no longer enabled" in status["error"]
    with pytest.raises(CommandError, match="broken off") as caught:
        gripper.record_stop()
    assert caught.value.reason == "recording_failed"


def test_a_blocking_play_leaves_a_hold_that_lasts(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """The SDK's motor faults 100 ms after the last frame; here the daemon goes on holding."""
    gripper.goto_openness(0.5)
    assert gripper.play(swing())
    where_mm = daemon.gripper.opening_mm
    site.run(3.0)
    assert daemon.phase is MotorPhase.ENABLED
    assert daemon.gripper.opening_mm == pytest.approx(where_mm, abs=0.5)
    assert not jaws_are_loose(site, daemon)


def test_looping_a_single_pose_holds_that_opening(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.play_start(pose(0.25), loop=True)
    site.run(4.0)
    status = gripper.trajectory_status()
    assert (status["active"], status["samples"], status["openness"]) == (True, 1, 0.25)
    assert daemon.gripper.opening_mm == pytest.approx(30.0, abs=1.5)
    gripper.play_stop()
    site.run(1.0)
    assert daemon.gripper.opening_mm == pytest.approx(30.0, abs=1.5)


@pytest.mark.parametrize("running", ["record", "watch", "play"])
def test_recording_and_replay_are_mutually_exclusive(
    site: Site, gripper: LiteGrip, running: str
) -> None:
    gripper.goto_openness(0.5)
    begin: dict[str, Callable[[], object]] = {
        "record": gripper.record_start,
        "watch": lambda: gripper.record_start(zero_gravity=False),
        "play": lambda: gripper.play_start(swing(), loop=True),
    }
    begin[running]()
    site.run(0.3)
    attempts: list[Callable[[], object]] = [
        *begin.values(),
        lambda: gripper.record(1.0),
        lambda: gripper.play(swing()),
    ]
    for attempt in attempts:
        with pytest.raises(TrajectoryBusyError) as caught:
            attempt()
        assert caught.value.reason == "trajectory_busy"
    assert gripper.trajectory_status()["active"]


@pytest.mark.parametrize("running", ["record", "watch", "play"])
@pytest.mark.parametrize("disable", [True, False])
@pytest.mark.parametrize("end", ["disconnect", "kill"])
def test_disconnect_stops_whichever_is_running(
    site: Site, daemon: Daemon, running: str, disable: bool, end: str
) -> None:
    """And so does the script's death."""
    gripper = LiteGrip("can0", disable_on_disconnect=disable)
    gripper.connect()
    gripper.enable()
    gripper.goto_openness(0.5)
    if running == "play":
        gripper.play_start(swing(), loop=True)
    else:
        gripper.record_start(zero_gravity=running == "record")
    site.run(0.4)
    if end == "kill":
        site.kill(gripper)
    else:
        gripper.disconnect()
    site.run(0.1)
    with LiteGrip("can0") as another:
        assert another.trajectory_status()["active"] is False
    assert daemon.is_energised is not disable
    if not disable:
        where_mm = daemon.gripper.opening_mm
        site.run(1.0)
        assert daemon.gripper.opening_mm == pytest.approx(where_mm, abs=1.0)
        assert not jaws_are_loose(site, daemon)


def test_both_need_a_calibration(site: Site, mount: str) -> None:
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        gripper.enable()
        attempts: list[Callable[[], object]] = [
            lambda: gripper.record(0.5),
            gripper.record_start,
            lambda: gripper.record_start(zero_gravity=False),
            lambda: gripper.play(swing()),
            lambda: gripper.play_start(swing()),
        ]
        for attempt in attempts:
            with pytest.raises(CommandError) as caught:
                attempt()
            assert caught.value.reason == "not_calibrated"
        assert not jaws_are_loose(site, daemon)
