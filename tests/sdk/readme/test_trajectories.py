"""The SDK's section "Trajectory record and replay": what recording and replay have in common."""

from collections.abc import Callable

import pytest

from litegrip_client import (
    LiteGrip,
    TrajectoryBusyError,
)
from litegrip_client.ctl.main import main
from tests.drop_in import Daemon, Site
from tests.geometry import TRAVEL_MM
from tests.sdk.readme.scenes import jaws_are_loose
from tests.sdk.readme.trajectories import off_mm, swing, teach


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
    line, usage = capsys.readouterr().out.splitlines()[1:]
    assert line.split()[:4] == ["pick", "100", "0.99", "s"]
    assert "1 of 500" in usage
    assert main(["play", "pick", "--repeat", "3"]) == 0
    assert daemon.gripper.opening_mm == pytest.approx(taught_mm, abs=2.5)
    assert "3 passes" in capsys.readouterr().out


def test_a_motion_is_captured_once_and_repeated_later(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    teach(site, daemon)
    with site.recorded(daemon) as first:
        taught = gripper.record(1.0)
    assert len(taught) == 100
    assert taught.longest_gap_s == pytest.approx(0.01, abs=1e-6)
    truth = [moment.opening_mm / TRAVEL_MM for moment in first]
    for sample in taught.samples:
        assert min(abs(sample.openness - one) for one in truth) < 0.01
    assert max(s.openness for s in taught.samples) == pytest.approx(max(truth), abs=0.01)
    assert gripper.close()
    with site.recorded(daemon) as again:
        result = gripper.play(taught)
    assert result
    assert (result.outcome, result.loops) == ("completed", 1)
    begun_s = again[-1].at_s
    ended = [off_mm(again, taught, begun_s - 0.005 * shift, TRAVEL_MM) for shift in range(150, 400)]
    assert min(ended) < 4.0


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
        lambda: gripper.teleop_start("master"),
        lambda: gripper.teleop_start("slave", host="192.168.1.20"),
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
