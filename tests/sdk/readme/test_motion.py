"""The SDK's section "How the motion works"."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from litegrip_client import HardwareError, LiteGrip, MotionConfig, MoveResult
from litegripd.motor import codec
from tests.drop_in import Daemon, Moment, Site
from tests.geometry import MM_RAD
from tests.sdk.readme.scenes import (
    CODE_RAD,
    CODE_RAD_S,
    LEAD_MM_RAD,
    content,
    jaws_are_loose,
    lead_mm,
    load_content,
)

LEAD_CODE_MM = CODE_RAD * LEAD_MM_RAD
RUN_IN = 1.1
"""Near a stop and not at it, the press is stronger by this: slow jaws would stick there."""
RAMPS: dict[str, Callable[[LiteGrip], object]] = {
    "open": lambda gripper: gripper.open(),
    "close": lambda gripper: gripper.close(),
    "grasp": lambda gripper: gripper.grasp(),
    "move_at_speed": lambda gripper: gripper.move_at_speed(20.0, 50.0),
    "goto": lambda gripper: gripper.goto(20.0, duration=0.8),
    "goto_rad": lambda gripper: gripper.goto_rad(-0.15, duration=0.8),
}


def travelling(moments: list[Moment]) -> list[Moment]:
    """Return the middle of a motion, between starting and arriving."""
    first_mm, last_mm = moments[0].opening_mm, moments[-1].opening_mm
    low_mm, high_mm = sorted((first_mm, last_mm))
    room_mm = (high_mm - low_mm) / 4
    return [m for m in moments if low_mm + room_mm < m.opening_mm < high_mm - room_mm]


def shifted(mount: str, inwards_rad: float) -> dict[str, Any]:
    """Return a calibration whose limits lie further inside than they do, or outside."""
    calibration = content(mount)
    sign = 1 if mount == "normal" else -1
    calibration["zero_position_rad"] -= sign * inwards_rad
    calibration["max_position_rad"] += sign * inwards_rad
    return calibration


@pytest.mark.parametrize("motion", RAMPS)
def test_motions_are_ramps_with_velocity_feed_forward_and_no_jump(
    site: Site, daemon: Daemon, gripper: LiteGrip, motion: str
) -> None:
    """goto_rad differs from the SDK's: it is a ramp, too, and not one constant target."""
    gripper.goto(60.0)
    if motion == "goto_rad" and daemon.mount == "reverse":
        gripper.goto_rad(-0.8)
    with site.recorded(daemon) as moments:
        RAMPS[motion](gripper)
    middle = travelling(moments)
    assert len(middle) > 40
    commands = [m.command for m in middle if m.command is not None]
    assert len(commands) == len(middle)  # one in every period
    steps = [later.position_rad - earlier.position_rad for earlier, later in pairwise(commands)]
    speed_rad_s = (commands[-1].position_rad - commands[0].position_rad) / (0.005 * len(steps))
    assert abs(speed_rad_s) > 0.4
    assert steps == pytest.approx([speed_rad_s * 0.005] * len(steps), abs=2 * CODE_RAD)
    for command in commands:
        assert command.velocity_rad_s == pytest.approx(speed_rad_s, abs=0.02 + CODE_RAD_S)
    positions = [moment.position_rad for moment in middle]
    moved = [abs(later - earlier) for earlier, later in pairwise(positions)]
    assert min(moved) > 0.3 * abs(speed_rad_s) * 0.005  # no step-and-stop


@pytest.mark.parametrize("action", ["open", "close"])
def test_the_commands_lead_is_capped_in_two_tiers_the_settle_phase_included(
    site: Site, daemon: Daemon, gripper: LiteGrip, action: str
) -> None:
    gripper.motion_config = MotionConfig(settle_s=1.0)
    with site.recorded(daemon) as moments:
        result = gripper.open() if action == "open" else gripper.close()
    pressing = 0
    for moment in moments[1:]:
        short_mm = abs(result.limit_rad - moment.measured_rad) * MM_RAD
        is_past = (moment.measured_rad - result.limit_rad) * (
            result.target_rad - result.limit_rad
        ) > 0.0
        near = is_past or short_mm <= 2.0
        pressing += near
        is_home = is_past or short_mm <= MotionConfig().stop_tol * MM_RAD
        cap_mm = 0.7 if is_home else 0.7 * RUN_IN if near else 4.0
        assert lead_mm(moment) <= cap_mm + LEAD_CODE_MM
    assert pressing > 200
    at_rest = [abs(moment.closing_torque_nm) for moment in moments[-150:]]
    assert at_rest == pytest.approx([0.94] * len(at_rest), abs=0.08)  # far from 8 N·m


@pytest.mark.parametrize("action", ["open", "close"])
def test_a_blocked_jaw_builds_up_its_lead_but_no_more_torque_than_kp_times_that(
    site: Site, mount: str, action: str
) -> None:
    """The command is a ramp in time: its error grows while the jaws stand, up to the cap.

    By the calibration the stop lies further out than it does, so that it is in the way.
    """
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        outwards = 0.2 if (action == "close") == (mount == "normal") else -0.2
        end = "max_position_rad" if action == "open" else "zero_position_rad"
        beyond = content(mount)
        load_content(gripper, {**beyond, end: beyond[end] + outwards})
        gripper.enable()
        gripper.motion_config = MotionConfig(stop_torque_cycles=100)
        with site.recorded(daemon) as moments:
            result = gripper.open() if action == "open" else gripper.close()
    assert not result
    most_mm = 2.0 / 100.0 * LEAD_MM_RAD  # the daemon pushes with 2 N·m on the way, the SDK with 5
    assert max(lead_mm(moment) for moment in moments) == pytest.approx(
        most_mm, abs=2 * LEAD_CODE_MM
    )
    torques = [abs(moment.closing_torque_nm) for moment in moments]
    assert 1.7 < max(torques) < 2.6


def test_the_torque_guard_lets_go_of_what_blocks_the_jaws(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """What the daemon adds: less than a stall window of pressing, then no torque at all."""
    daemon.gripper.put_object(width_mm=40.0)
    with site.recorded(daemon) as moments:
        result = gripper.close()
    assert (result.ok, result.stalled, result.protected) == (False, True, True)
    touched_s = next(moment.at_s for moment in moments if moment.opening_mm < 40.0)
    strong = [m.at_s for m in moments if m.closing_torque_nm > 0.7 and m.at_s > touched_s]
    assert strong[-1] - touched_s < 0.26
    assert abs(moments[-10].closing_torque_nm) < 0.05
    site.run(1.0)
    assert not jaws_are_loose(site, daemon)  # and holds there


@pytest.mark.parametrize(("lead", "moves"), [(4.0, True), (0.1, False)])
def test_too_small_a_lead_does_not_break_static_friction_and_reports_a_false_stall(
    daemon: Daemon, gripper: LiteGrip, lead: float, moves: bool
) -> None:
    gripper.motion_config = MotionConfig(
        speed_mm_s=5.0, max_lead_mm=lead, stop_lead_mm=min(lead, 0.7)
    )
    gripper.goto(30.0, duration=None) if moves else None
    before_mm = daemon.gripper.opening_mm
    result = gripper.close()
    assert result.ok is moves
    assert result.stalled
    assert (abs(before_mm - daemon.gripper.opening_mm) > 20.0) is moves


@pytest.mark.parametrize("off", [-0.012, 0.012])
def test_a_slightly_off_calibration_does_not_move_the_endpoint(
    site: Site, mount: str, off: float
) -> None:
    """The calibrated limits only say which way to go, and what the millimetres are."""
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    ends = []
    with LiteGrip("can0") as gripper:
        for calibration in (content(mount), shifted(mount, off)):
            load_content(gripper, calibration)
            gripper.enable()
            results: list[MoveResult] = []
            for act in (gripper.open, gripper.close):
                results.append(act())
                ends.append(daemon.gripper.opening_mm)
            assert all(results)
            for result in results:
                beyond = abs(result.target_rad - result.limit_rad)
                assert beyond == pytest.approx(0.05 * gripper.config.travel_mm / MM_RAD)  # type: ignore[operator]
    assert ends[2:] == pytest.approx(ends[:2], abs=0.3)


@pytest.mark.parametrize(("held_s", "stalls"), [(0.1, False), (1.0, True)])
def test_a_stall_needs_a_whole_window_of_standing_still(
    site: Site, daemon: Daemon, gripper: LiteGrip, held_s: float, stalls: bool
) -> None:
    """A hand holds the jaws for a moment: two samples do not move, but the window does."""
    closing = daemon.gripper.parameters.close_sign
    gripper.motion_config = MotionConfig(stop_torque_cycles=100)

    def hold() -> None:
        daemon.gripper.push(-2.2 * closing)
        site.after(held_s, lambda: daemon.gripper.push(0.0))

    site.when(lambda: daemon.gripper.opening_mm < 35.0, hold)
    with site.recorded(daemon) as moments:
        result = gripper.close()
    assert result.ok is not stalls
    middle = [m for m in moments if m.opening_mm > 20.0]
    sampled = [m.opening_mm for m in middle[:: round(0.05 / 0.005)]]
    assert any(earlier - later < 0.5 for earlier, later in pairwise(sampled))
    assert (daemon.gripper.opening_mm > 20.0) is stalls


def test_stick_slip_at_the_closing_side_is_no_stall(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """Slow jaws stick and slip there: whole samples without any motion, and yet it gets home."""
    gripper.goto(10.0)
    gripper.motion_config = MotionConfig(speed_mm_s=4.0)
    with site.recorded(daemon) as moments:
        result = gripper.close()
    assert result
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)
    zone = [m.opening_mm for m in moments if 2.0 < m.opening_mm < 7.0]
    moved = [a - b for a, b in zip(zone, zone[10:], strict=False)]  # in 50 ms
    assert min(moved) < 0.2 * 4.0 * 0.05


@pytest.mark.parametrize("settle", [0.0, 2.0])
def test_the_settle_phase_is_not_stall_checked(
    site: Site, daemon: Daemon, gripper: LiteGrip, settle: float
) -> None:
    gripper.motion_config = MotionConfig(settle_s=settle)
    with site.recorded(daemon) as moments:
        assert gripper.close()
    last_mm = moments[-1].opening_mm
    still_s = 0.005 * sum(abs(moment.opening_mm - last_mm) < 0.05 for moment in moments)
    assert still_s == pytest.approx(settle, abs=0.35)


def test_enable_clears_a_genuine_fault_first(site: Site, daemon: Daemon) -> None:
    with LiteGrip("can0") as gripper:
        assert gripper.enable()
        daemon.gripper.set_supply(0.0)
        site.run(0.2)
        daemon.gripper.set_supply(24.0)
        site.run(0.2)
        assert gripper.get_state().error_code == 9
        began_s = site.now_s
        result = gripper.enable()
        assert result
        assert result.state.error_code == 1
        special = [s.frame.data for s in daemon.sent if s.at_s > began_s]
        assert special.index(codec.CLEAR_FAULT) < special.index(codec.ENABLE)


def test_a_fault_that_stays_is_no_success(site: Site, daemon: Daemon) -> None:
    daemon.gripper.set_supply(0.0)
    site.run(0.2)
    with LiteGrip("can0") as gripper, pytest.raises(HardwareError) as caught:
        gripper.enable()
    assert caught.value.reason == "motor_fault"
    assert not daemon.is_energised
