"""The SDK's section "How the motion works"."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from litegrip_client import HardwareError, LiteGrip, MotionConfig
from litegripd.motor import codec
from tests.drop_in import Daemon, Moment, Site
from tests.sdk.readme.scenes import (
    CODE_RAD,
    CODE_RAD_S,
    jaws_are_loose,
)

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
