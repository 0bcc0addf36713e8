"""The SDK's section "The six actions"."""

from collections.abc import Callable

import pytest

from litegrip_client import (
    CalibrationData,
    EnableResult,
    GraspResult,
    GripperActions,
    HardwareError,
    LiteGrip,
    MotionConfig,
    MoveResult,
)
from tests.drop_in import Daemon, Site
from tests.geometry import TRAVEL_MM, TRAVEL_RAD
from tests.sdk.readme.scenes import (
    CODE_RAD,
    LEAD_MM_RAD,
    jaws_are_loose,
    speed_mm_s,
)

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
    """At 50 mm/s. The target lies past the stop, so the jaws never get there."""
    stops_mm = {"open": TRAVEL_MM, "close": 0.0}
    moves = {"open": gripper.open, "close": gripper.close}
    other_end, move = moves.pop("close" if action == "open" else "open"), moves[action]
    other_end()
    began_s = site.now_s
    with site.recorded(daemon) as moments:
        result = move()
    config, jaws = gripper.config, daemon.gripper
    assert isinstance(result, MoveResult)
    assert (result.ok, result.stalled, result.reached) == (True, True, False)
    assert bool(result) is True
    assert result.limit_rad == (config.pos_open_rad if action == "open" else config.pos_closed_rad)
    outwards = -1 if action == "open" else 1
    beyond_rad = (result.target_rad - result.limit_rad) * (config.close_sign or 0) * outwards
    assert beyond_rad == pytest.approx(0.05 * TRAVEL_RAD)
    assert jaws.opening_mm == pytest.approx(stops_mm[action], abs=0.5)
    assert abs(jaws.position_rad - result.limit_rad) < 0.02
    assert abs(result.target_rad - jaws.position_rad) > 0.05
    ends_mm = (20.0, 77.0) if action == "open" else (77.0, 20.0)
    assert speed_mm_s(moments, *ends_mm) == pytest.approx(50.0, rel=0.03)
    still = [m for m in moments if abs(m.opening_mm - jaws.opening_mm) < 0.1]
    assert len(still) > 50  # it stood at the stop, which alone ended the move
    settled = [moment.closing_torque_nm * outwards for moment in moments[-50:]]
    assert settled == pytest.approx([100.0 * 0.7 / LEAD_MM_RAD] * len(settled), abs=0.08)
    assert settled[-1] == pytest.approx(3.0 / 3, rel=0.15)  # a third of the rating
    assert result.state.position_rad == pytest.approx(jaws.position_rad, abs=0.002)
    assert result.state.enabled
    commands = [command for _, command in daemon.commands_since(began_s)][-result.steps :]
    assert len(commands) == result.steps
    last_rad = [command.position_rad for command in commands[-3:]]
    assert min(abs(rad - result.final_cmd_rad) for rad in last_rad) <= CODE_RAD


def test_open_that_is_held_back_is_no_success(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    hold_back_from(site, daemon, 80.0, 6.0)
    result = gripper.open()
    assert not result
    assert result.stalled
    assert daemon.gripper.opening_mm < 100.0


@pytest.mark.parametrize("width_mm", [15.0, 50.0])
def test_grasp_closes_until_it_stalls_and_then_holds_the_force(
    daemon: Daemon, gripper: LiteGrip, width_mm: float
) -> None:
    daemon.gripper.put_object(width_mm=width_mm)
    result = gripper.grasp(force_n=12.0, hold_s=1.1)
    assert isinstance(result, GraspResult)
    assert (result.ok, result.stalled, result.reached) == (True, True, False)
    assert bool(result) is True
    assert (result.force_n, result.cycles) == (12.0, 5)  # a slice is 0.2 s
    assert result.width_mm == pytest.approx(width_mm, abs=1.0)
    assert result.state.position_rad == pytest.approx(daemon.gripper.position_rad, abs=0.002)
    assert daemon.closing_torque_nm == pytest.approx(1.2, abs=0.1)
    assert daemon.gripper.opening_mm == pytest.approx(width_mm, abs=1.0)
    assert abs(result.target_rad - daemon.gripper.position_rad) > 0.02  # that of empty jaws


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
        assert isinstance(gripper.motion_config, MotionConfig)
        assert gripper.disable_on_disconnect is True
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
