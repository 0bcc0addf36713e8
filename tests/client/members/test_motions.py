"""The SDK's motions on both mounts: what the frames then say, and what the jaws do."""

import math
from collections.abc import Callable
from itertools import pairwise

import pytest

from litegrip_client import (
    ErrorCode,
    HardwareError,
    LiteGrip,
    ParameterError,
    StoppedError,
    TeleopBusyError,
    TrajectoryBusyError,
)
from tests.drop_in import Daemon, Moment, Site
from tests.geometry import MM_RAD

WAYS: dict[str, Callable[[LiteGrip, float], object]] = {
    "goto": lambda g, _rad: g.goto(30.0, 150.0, 2.0),
    "goto_rad": lambda g, rad: g.goto_rad(rad, 150.0, 2.0, 0.0, 0.0, 0.5),
    "move_to": lambda g, rad: g.move_to(rad, 150.0, 2.0, 0.0, 0.5),
    "move_at_speed": lambda g, _rad: g.move_at_speed(30.0, 60.0, 150.0, 2.0),
    "move_at_speed_rad": lambda g, rad: g.move_at_speed_rad(rad, 60.0 / MM_RAD, 150.0, 2.0),
}


def interrupt() -> None:
    raise KeyboardInterrupt


def at_30_mm(daemon: Daemon) -> float:
    geometry = daemon.controller.geometry
    assert geometry is not None
    return geometry.closed_rad - geometry.close_sign * geometry.to_rad(30.0)


def stiffness(moments: list[Moment]) -> set[int]:
    """Return the stiffness of the commands of a motion, without the hold after it."""
    commands = [m.command for m in moments if m.command and abs(m.command.velocity_rad_s) > 0.3]
    assert len(commands) > 50
    return {round(command.kp_nm_rad) for command in commands}


@pytest.mark.parametrize("way", WAYS)
def test_a_move_takes_half_a_second_with_the_gains_that_it_is_given(
    site: Site, daemon: Daemon, gripper: LiteGrip, way: str
) -> None:
    began_s = site.now_s
    site.when(lambda: daemon.gripper.opening_mm < 30.5, lambda: arrived.append(site.now_s))
    arrived: list[float] = []
    with site.recorded(daemon) as moments:
        assert WAYS[way](gripper, at_30_mm(daemon))
    assert arrived == [pytest.approx(began_s + 0.5, abs=0.06)]
    assert stiffness(moments) == {100}  # of 150, which swings some grippers
    assert daemon.gripper.opening_mm == pytest.approx(30.0, abs=0.6)


def test_stop_takes_the_torque_off_at_once_and_latches_nothing(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    assert gripper.grasp(10.0, until="verdict")
    gripper.stop()
    with site.recorded(daemon) as moments:
        site.run(0.1)
    commands = [moment.command for moment in moments if moment.command is not None]
    assert {(one.kp_nm_rad, one.kd_nm_s_rad) for one in commands} == {(0.0, 0.0)}
    assert max(abs(one.torque_nm) for one in commands) < 0.01
    assert gripper.get_state().stop is None
    daemon.gripper.remove_object()
    assert gripper.open()


def close_and_stop(gripper: LiteGrip) -> None:
    try:
        gripper.close()
    finally:
        gripper.stop()


def test_stop_in_finally_does_not_hide_what_happened(gripper: LiteGrip, site: Site) -> None:
    site.after(0.3, interrupt)
    with pytest.raises(KeyboardInterrupt):
        close_and_stop(gripper)
    assert gripper.get_state().mode == "relaxed"
    gripper.disable()
    gripper.stop()  # a motor without power has no torque


def test_stop_ends_a_motion_of_the_same_script(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    """It is another thread's in life; here one for which nobody waits."""
    params = {"opening_mm": 5.0, "speed_mm_s": 20.0, "wait": False}
    job = gripper._session.connection.call("motion.move", params)["job"]
    site.run(0.3)
    assert gripper.get_state().mode == "moving"
    gripper.stop()
    assert gripper.get_state().mode == "relaxed"
    ended = next(one for one in gripper.jobs() if one["job"] == job)
    assert (ended["state"], ended["error"]["data"]["reason"]) == ("cancelled", "replaced")


def test_stop_of_a_script_that_does_not_move_the_gripper_stops_it_for_all(
    site: Site, daemon: Daemon, gripper: LiteGrip, caplog: pytest.LogCaptureFixture
) -> None:
    with LiteGrip("can0") as other:
        other.stop()
        assert caplog.messages[-1] == (
            "stop(): the gripper is stopped for every client, until gripper.clear_stop():"
            " another call or object of this program has it"
        )
        assert gripper.get_state().stop is not None
        with pytest.raises(StoppedError):
            gripper.open()
        site.run(0.05)
        command = daemon.command_now()
        assert command is not None
        assert command.kp_nm_rad == 0.0
        other.clear_stop()
    assert gripper.open()


def test_a_motion_of_this_script_ends_when_another_program_stops(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    other = daemon.client()
    site.after(0.3, lambda: other.result("stop", level="hold", why="a visitor"))
    with pytest.raises(StoppedError, match="a visitor"):
        gripper.move_at_speed(10.0)


def test_a_force_is_held_for_its_duration_and_after_it(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=58.0)
    began_s = site.now_s
    assert gripper.set_force(8.0, 1.5) is True
    assert site.now_s - began_s == pytest.approx(1.5, abs=0.05)
    assert daemon.closing_torque_nm == pytest.approx(0.8, abs=0.1)
    began_s = site.now_s
    assert gripper.set_force(force_n=5.0) is True
    assert site.now_s - began_s == pytest.approx(0.3, abs=0.05)
    site.run(1.0)
    assert daemon.closing_torque_nm == pytest.approx(0.5, abs=0.1)


def test_zero_gravity_for_a_while(site: Site, daemon: Daemon, gripper: LiteGrip) -> None:
    began_s = site.now_s
    site.after(1.0, lambda: loose.append(daemon.command_now()))
    loose: list[object] = []
    assert gripper.enter_zero_gravity(duration=3.0) is True
    assert site.now_s - began_s == pytest.approx(3.0, abs=0.05)
    assert [getattr(one, "kp_nm_rad", None) for one in loose] == [0.0]
    assert gripper.get_state().mode == "holding"
    assert gripper.enter_zero_gravity() is True
    assert gripper.get_state().mode == "relaxed"
    assert gripper.exit_zero_gravity() is True
    assert gripper.get_state().mode == "holding"
    with pytest.raises(ParameterError, match="duration is -1"):
        gripper.enter_zero_gravity(-1.0)


def test_a_cleared_fault_leaves_the_motor_enabled_unless_that_is_not_wished(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    assert gripper.clear_fault() is True  # an enabled motor has none
    daemon.gripper.latch_fault(0xE)
    site.run(0.1)
    with pytest.raises(HardwareError, match="overload") as caught:
        gripper.open()
    assert caught.value.error_code == ErrorCode.OVERLOAD
    assert gripper.get_state().is_error
    assert gripper.clear_fault(enable=False) is True
    site.run(0.1)
    is_enabled = gripper.is_enabled
    assert (is_enabled, daemon.is_energised) == (False, False)
    assert gripper.clear_fault() is True
    assert gripper.is_enabled
    assert gripper.open()


# Teleoperation


def test_teleoperation_and_trajectories_exclude_each_other(gripper: LiteGrip) -> None:
    gripper.record_start()
    with pytest.raises((TeleopBusyError, TrajectoryBusyError)):
        gripper.teleop_start("slave", fake_leader=True)
    gripper.record_stop()
    gripper.teleop_start("slave", fake_leader=True, align=True, align_speed_mm_s=30.0)
    with pytest.raises(TeleopBusyError):
        gripper.record(1.0)
    with pytest.raises(TeleopBusyError):
        gripper.open()
    status = gripper.teleop_stop(timeout=2.0)
    assert status["active"] is False
    assert math.isfinite(status["torque_nm"])  # it is printed as a number, and written as JSON


@pytest.mark.parametrize("speed", [15.0, 30.0, 60.0])
def test_a_follower_aligns_at_the_speed_that_it_is_given(
    site: Site, daemon: Daemon, gripper: LiteGrip, speed: float
) -> None:
    """The fake leader begins open; the jaws are at 20 mm."""
    gripper.goto(20.0)
    with site.recorded(daemon) as moments:
        gripper.teleop_start("slave", fake_leader=True, align_speed_mm_s=speed)
        site.run(0.7)
    travelled_mm = moments[-1].opening_mm - moments[-41].opening_mm
    assert travelled_mm / 0.2 == pytest.approx(speed, rel=0.15)


def test_without_aligning_a_follower_goes_there_at_once_and_does_not_jump(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto(60.0)
    with site.recorded(daemon) as moments:
        gripper.teleop_start("slave", fake_leader=True, align=False, align_speed_mm_s=5.0)
        site.run(0.8)
    openings = [moment.opening_mm for moment in moments]
    assert openings[-1] - openings[0] > 10.0  # and not 4, at 5 mm/s
    steps = [abs(later - earlier) for earlier, later in pairwise(openings)]
    assert max(steps) < 1.0
