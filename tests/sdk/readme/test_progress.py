"""The SDK's section "Progress reporting"."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from litegrip_client import LiteGrip, MoveProgress
from tests.drop_in import Daemon, Site

MOTIONS: dict[str, Callable[..., object]] = {
    "open": lambda gripper, **more: gripper.open(**more),
    "close": lambda gripper, **more: gripper.close(**more),
    "grasp": lambda gripper, **more: gripper.grasp(hold_s=1.0, **more),
}


def test_the_motion_actions_never_print(
    daemon: Daemon, gripper: LiteGrip, capfd: pytest.CaptureFixture[str]
) -> None:
    gripper.open()
    gripper.close()
    gripper.open()
    daemon.gripper.put_object(width_mm=40.0)
    gripper.grasp(hold_s=1.0)
    gripper.disable()
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


@pytest.mark.parametrize("motion", MOTIONS)
def test_progress_is_called_with_snapshots_at_the_sampling_rate(
    site: Site, daemon: Daemon, gripper: LiteGrip, motion: str
) -> None:
    gripper.open()
    daemon.gripper.put_object(width_mm=10.0)
    calls: list[tuple[float, MoveProgress, float]] = []
    began_s = site.now_s
    MOTIONS[motion](
        gripper,
        progress=lambda p: calls.append((site.now_s, p, daemon.gripper.position_rad)),
    )
    lasted_s = site.now_s - began_s
    assert all(isinstance(report, MoveProgress) for _, report, _ in calls)
    gaps = [later[0] - earlier[0] for earlier, later in pairwise(calls)]
    assert gaps == pytest.approx([0.05] * len(gaps), abs=0.006)
    assert len(calls) == pytest.approx(lasted_s / 0.05, abs=2)
    for _, report, position_rad in calls:
        assert report.pos_rad == pytest.approx(position_rad, abs=0.01)
        assert abs(report.cmd_rad - report.pos_rad) < 0.06


@pytest.mark.parametrize("method", ["zero", "calibrate"])
def test_zero_and_calibrate_print_their_own_progress_to_stdout(
    gripper: LiteGrip, capfd: pytest.CaptureFixture[str], method: str
) -> None:
    data = gripper.zero() if method == "zero" else gripper.calibrate()
    captured = capfd.readouterr()
    assert captured.err == ""
    assert "[probe_open]" in captured.out
    assert "[probe_closed]" in captured.out
    assert f"closed {data.zero_position_rad:+.4f} rad" in captured.out


def test_the_phase_of_a_grasp_is_hold_while_force_is_held(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    reports: list[tuple[float, MoveProgress, float]] = []
    gripper.grasp(
        hold_s=2.0,
        progress=lambda p: reports.append((site.now_s, p, daemon.gripper.opening_mm)),
    )
    phases = [report.phase for _, report, _ in reports]
    first = phases.index("hold")
    assert set(phases[:first]) == {"move"}
    assert {report.stage for _, report, _ in reports[:first]} == {"approach"}
    assert set(phases[first:]) == {"hold"}
    assert reports[-1][0] - reports[first][0] == pytest.approx(2.0, abs=0.1)
    assert all(report.total_steps == 0 for _, report, _ in reports[first:])
    assert all(report.total_steps > 0 for _, report, _ in reports[:first])
    assert all(opening_mm == pytest.approx(30.0, abs=1.0) for _, _, opening_mm in reports[first:])
    held = [report.torque_nm for at_s, report, _ in reports if at_s > reports[-1][0] - 0.5]
    assert [abs(torque_nm) for torque_nm in held] == pytest.approx([2.0] * len(held), abs=0.1)
