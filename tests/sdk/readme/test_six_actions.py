"""The SDK's section "The six actions"."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from litegrip_client import (
    CalibrationData,
    EnableResult,
    GraspResult,
    GripperActions,
    HardwareError,
    LiteGrip,
    MoveResult,
)
from litegripd.motor import codec
from tests.drop_in import Daemon, Site
from tests.geometry import SPAN_MM, TRAVEL_MM, TRAVEL_RAD
from tests.sdk.readme.scenes import bench_unit, jaws_are_loose

ACTIONS: dict[str, tuple[Callable[[GripperActions], object], type]] = {
    "enable": (lambda actions: actions.enable(retries=2), EnableResult),
    "open": (lambda actions: actions.open(speed_mm_s=60.0), MoveResult),
    "close": (lambda actions: actions.close(speed_mm_s=60.0), MoveResult),
    "grasp": (lambda actions: actions.grasp(force_n=8.0, hold_s=0.5), GraspResult),
    "zero": (lambda actions: actions.zero(), CalibrationData),
    "disable": (lambda actions: actions.disable(), bool),
}


def hold_back_from(site: Site, daemon: Daemon, opening_mm: float, torque_nm: float) -> None:
    """Have a hand hold the jaws from opening further than this."""
    closing_nm = torque_nm * daemon.gripper.parameters.close_sign
    site.when(
        lambda: daemon.gripper.opening_mm > opening_mm, lambda: daemon.gripper.push(closing_nm)
    )


@pytest.mark.parametrize("action", ["open", "close"])
def test_open_and_close_ramp_past_the_calibrated_stop_and_the_mechanical_one_ends_the_move(
    site: Site, daemon: Daemon, gripper: LiteGrip, action: str
) -> None:
    move, stop_mm = (gripper.open, TRAVEL_MM) if action == "open" else (gripper.close, 0.0)
    with site.recorded(daemon) as moments:
        result = move()
    config = gripper.config
    assert isinstance(result, MoveResult)
    assert result.limit_rad == (config.pos_open_rad if action == "open" else config.pos_closed_rad)
    outwards = -1 if action == "open" else 1
    beyond_rad = (result.target_rad - result.limit_rad) * (config.close_sign or 0) * outwards
    assert beyond_rad == pytest.approx(0.05 * TRAVEL_RAD)
    assert daemon.gripper.opening_mm == pytest.approx(stop_mm, abs=1.0)
    still = [m for m in moments if abs(m.opening_mm - daemon.gripper.opening_mm) < 0.1]
    assert len(still) > 50  # it stood at the stop, which alone ended the move


def test_open_that_is_held_back_is_no_success(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    hold_back_from(site, daemon, 80.0, 6.0)
    result = gripper.open()
    assert not result
    assert result.stalled
    assert daemon.gripper.opening_mm < 100.0


def test_close_onto_an_obstacle_is_no_success(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=40.0)
    with site.recorded(daemon) as moments:
        result = gripper.close()
    assert not result
    assert result.stalled
    assert min(moment.opening_mm for moment in moments) == pytest.approx(40.0, abs=3.0)


def test_grasp_closes_until_it_stalls_and_then_holds_the_force(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=40.0)
    with site.recorded(daemon) as moments:
        result = gripper.grasp(force_n=12.0, hold_s=2.0)
    assert isinstance(result, GraspResult)
    assert result.stalled
    assert result.force_n == 12.0
    assert result.width_mm == pytest.approx(40.0, abs=1.0)
    assert moments[-1].closing_torque_nm == pytest.approx(1.2, abs=0.1)
    assert daemon.gripper.opening_mm == pytest.approx(40.0, abs=1.0)


def test_grasp_with_hold_s_0_holds_for_ever(site: Site, daemon: Daemon, gripper: LiteGrip) -> None:
    daemon.gripper.put_object(width_mm=40.0)

    def interrupt() -> None:
        raise KeyboardInterrupt

    site.after(15.0, interrupt)
    with site.recorded(daemon) as moments, pytest.raises(KeyboardInterrupt):
        gripper.grasp(force_n=8.0)
    held = [moment.closing_torque_nm for moment in moments if moment.at_s > moments[0].at_s + 3.0]
    assert len(held) > 2000
    assert held == pytest.approx([0.8] * len(held), abs=0.1)
    assert all(job["state"] != "running" for job in gripper.jobs())
    site.run(1.0)
    assert daemon.closing_torque_nm == pytest.approx(0.8, abs=0.1)  # and goes on after Ctrl-C


def test_after_hold_s_the_force_goes_on_until_told_otherwise(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """Where the daemon differs: the SDK's grasp has ended then."""
    daemon.gripper.put_object(width_mm=40.0)
    assert gripper.grasp(force_n=8.0, hold_s=1.0)
    site.run(5.0)
    assert daemon.closing_torque_nm == pytest.approx(0.8, abs=0.1)
    assert gripper.get_state().is_grasped
    assert gripper.open()
    assert daemon.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=1.0)


def test_zero_probes_both_stops_derives_travel_and_scale_and_saves(site: Site, mount: str) -> None:
    unit = bench_unit(mount)
    daemon = site.add(Daemon(mount=mount, calibrated=False, parameters=unit))
    with LiteGrip("can0", mount=mount) as gripper:
        gripper.enable()
        with site.recorded(daemon) as moments:
            data = gripper.zero()
        saved = json.loads(Path(gripper.save_calibration()).read_text(encoding="utf-8"))
    openings = [moment.opening_mm for moment in moments]
    assert max(openings) == pytest.approx(SPAN_MM, abs=1.0)
    assert -3.0 < min(openings) < 1.0  # the press that confirms the stop gives the soft end a way
    travel_rad = abs(unit.closed_rad - unit.open_rad)
    assert isinstance(data, CalibrationData)
    assert data.travel_range_rad == pytest.approx(travel_rad, rel=0.01)
    assert data.rad_to_mm == pytest.approx(unit.rad_to_mm, rel=0.01)
    for key in ("zero_position_rad", "max_position_rad", "rad_to_mm", "travel_range_rad"):
        assert saved[key] == getattr(data, key)


def test_zero_is_on_disk_without_being_saved_once_more(site: Site, home: Path, mount: str) -> None:
    site.add(Daemon(mount=mount))
    with LiteGrip("can0") as gripper:
        gripper.enable()
        data = gripper.zero()
    saved = json.loads((home / "state" / "can0_calibration.json").read_text(encoding="utf-8"))
    assert saved["zero_position_rad"] == data.zero_position_rad


@pytest.mark.parametrize("declared", ["normal", "reverse"])
def test_zero_preserves_the_declared_direction_since_a_stall_tells_no_stop_from_the_other(
    site: Site, mount: str, declared: str
) -> None:
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0", mount=declared) as gripper:
        gripper.enable()
        data = gripper.zero()
        assert (data.mount, gripper.mount) == (declared, declared)
        gripper.close()
    closed_mm = 0.0 if declared == mount else TRAVEL_MM
    assert daemon.gripper.opening_mm == pytest.approx(closed_mm, abs=1.0)


def test_zero_with_something_in_its_way_fails_and_changes_nothing(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=50.0)
    before = gripper.config
    with pytest.raises(HardwareError) as caught:
        gripper.zero()
    assert caught.value.reason == "implausible_travel"
    assert gripper.config == before


def test_enable_re_reads_the_status_and_retries_until_it_says_enabled(
    site: Site, daemon: Daemon
) -> None:
    """The motor hears nothing: enabling it is no success, however often it is sent."""
    daemon.lose_to_motor = lambda frame: frame.data == codec.ENABLE
    with LiteGrip("can0") as gripper:
        result = gripper.enable(retries=4)
        assert isinstance(result, EnableResult)
        assert not result
        assert (result.tries, result.state.enabled) == (4, False)
        assert not daemon.is_energised
        daemon.lose_to_motor = lambda _frame: False
        assert gripper.enable()
        assert daemon.is_energised


def test_disable_leaves_no_torque_and_jaws_that_a_hand_can_move(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.close()
    assert not jaws_are_loose(site, daemon)
    assert gripper.disable() is True
    assert not daemon.is_energised
    assert daemon.gripper.motor_torque_nm == 0.0
    assert jaws_are_loose(site, daemon)


def test_disable_that_the_motor_does_not_confirm_is_no_success(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.lose_from_motor = lambda _frame: True
    with pytest.raises(HardwareError):
        gripper.disable()
    daemon.lose_from_motor = lambda _frame: False
    assert gripper.disable() is True


def test_each_action_is_reachable_through_actions(site: Site, daemon: Daemon) -> None:
    daemon.gripper.put_object(width_mm=40.0)
    with LiteGrip("can0") as gripper:
        assert isinstance(gripper.actions, GripperActions)
        for name, (act, kind) in ACTIONS.items():
            assert isinstance(act(gripper.actions), kind), name
            if name == "grasp":
                assert daemon.closing_torque_nm == pytest.approx(0.8, abs=0.1)
                daemon.gripper.remove_object()
                gripper.open()
        assert not daemon.is_energised


def test_another_driver_layer_can_be_built_on_the_actions(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    class Node:
        """A ROS 2 node, in short: it knows nothing but the actions."""

        def __init__(self, actions: GripperActions) -> None:
            self._actions = actions
            self.feedback: list[float] = []

        def close(self) -> bool:
            report = self.feedback.append
            return bool(self._actions.close(progress=lambda p: report(p.pos_rad)))

    node = Node(gripper.actions)
    assert node.close()
    assert len(node.feedback) > 20
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)
