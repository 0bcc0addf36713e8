"""What the daemon refuses, and who says why."""

from __future__ import annotations

import os

from action_msgs.msg import GoalStatus
from processes import Daemon, Gripper

ABORTED = GoalStatus.STATUS_ABORTED


def refused(gripper: Gripper, position_m: float = 0.02) -> str:
    """Send a goal that is aborted; return why, as the log and the diagnostics have it."""
    status, result = gripper.go(position_m)
    assert (status, result.reached_goal, result.stalled) == (ABORTED, False, False)
    line = gripper.process.said("goal aborted: ")[-1].partition("goal aborted: ")[2]

    def is_told() -> bool:
        rows = [pair for one in gripper.health for pair in one.values]
        return any((pair.key, pair.value) == ("last refusal", line) for pair in rows)

    gripper.ros.spin_until(is_told, f"/diagnostics has {line!r}")
    return line


def test_a_lease_of_another_program_with_its_owner(gripper: Gripper, daemon: Daemon) -> None:
    assert gripper.call("disable").success  # which gives the lease back
    gripper.new_state()  # it is connected again
    with daemon.gripper() as other:
        other.enable()
        assert f"(pid {os.getpid()}) has the gripper" in refused(gripper)
        answer = gripper.call("enable")
        assert not answer.success
        assert "lease" in answer.message
    assert gripper.call("enable").success


def test_a_stop_until_it_is_cleared(gripper: Gripper) -> None:
    goal = gripper.send(0.0, velocity_m_s=0.01)
    assert goal is not None
    assert gripper.call("stop").success
    assert goal.end()[0] == ABORTED
    assert "~/clear" in refused(gripper)
    status = gripper.is_healthy(1, "stopped (hold)")
    assert any(pair.key == "stop" and pair.value == "hold" for pair in status.values)
    answer = gripper.call("clear")
    assert answer.success, answer.message
    assert gripper.go(0.05)[0] == GoalStatus.STATUS_SUCCEEDED


def test_a_stop_of_somebody_else(gripper: Gripper, daemon: Daemon) -> None:
    with daemon.gripper() as other:
        other.software_stop("hold", "the door is open")
    assert "the door is open" in refused(gripper)
    gripper.is_healthy(1, "the door is open")
    assert gripper.call("clear").success


def test_a_motor_that_is_disabled(gripper: Gripper) -> None:
    assert gripper.call("disable").success
    gripper.new_state()  # it is connected again
    assert "~/enable" in refused(gripper)


def test_a_position_outside_the_travel_with_the_travel(gripper: Gripper) -> None:
    assert "opening_mm is 200 mm, the calibrated travel is 0 to 86.9 mm" in refused(gripper, 0.2)


def test_a_gripper_that_is_not_calibrated(start) -> None:
    _, gripper = start(is_calibrated=False)
    gripper.is_healthy(1, "not calibrated")
    assert gripper.call("enable").success
    assert "calibrat" in refused(gripper)
    assert not gripper.states
