"""The SDK's section "Trajectory record and replay": its sentences about recording."""

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    LiteGrip,
    Trajectory,
    TrajectoryEmptyError,
    TrajectoryNotActiveError,
)
from tests.drop_in import Daemon, Site
from tests.sdk.readme.scenes import jaws_are_loose
from tests.sdk.readme.trajectories import assert_slack, push


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


@pytest.mark.parametrize(("lasts_s", "count"), [(0.25, 25), (0.0, 1)])
def test_record_stop_returns_what_was_captured(
    site: Site, gripper: LiteGrip, lasts_s: float, count: int
) -> None:
    gripper.record_start()
    site.run(lasts_s)
    assert len(gripper.record_stop()) == pytest.approx(count, abs=1 if lasts_s else 0)
    assert gripper.get_state().mode == "holding"
    with pytest.raises(TrajectoryNotActiveError, match="no recording is under way"):
        gripper.record_stop()


def test_a_recording_without_samples_raises_unless_that_is_allowed(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.lose_from_motor = lambda _frame: True
    site.run(0.01)
    gripper.record_start(zero_gravity=False)
    site.tick()
    with pytest.raises(CommandError, match="no samples") as caught:
        gripper.record_stop()
    assert isinstance(caught.value, TrajectoryEmptyError)
    assert caught.value.reason == "recording_failed"
    empty = gripper.record_stop(allow_empty=True)
    assert (len(empty), empty.duration_s) == (0, 0.0)
    daemon.lose_from_motor = lambda _frame: False


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
