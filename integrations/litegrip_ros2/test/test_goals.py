"""Goals by real action clients, in a process of their own."""

from __future__ import annotations

from action_msgs.msg import GoalStatus
from processes import Daemon, Gripper, near

SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)


def test_a_position_is_reached(gripper: Gripper, daemon: Daemon) -> None:
    status, result = gripper.go(0.04)
    assert (status, result.reached_goal, result.stalled) == (SUCCEEDED, True, False)
    assert result.state.name == ["gripper_opening_joint"]
    assert near(result.state.position[0], 0.04, 0.001)
    assert near(daemon.state()["opening_mm"], 40.0, 1.0)


def test_a_velocity_is_the_speed(gripper: Gripper) -> None:
    goal = gripper.send(0.01, velocity_m_s=0.02)
    assert goal is not None
    gripper.ros.spin_until(lambda: gripper.new_state().position[0] < 0.058, "the jaws move")
    fastest = -min(gripper.new_state().velocity[0] for _ in range(20))
    assert near(fastest, 0.02, 0.008)
    assert goal.cancel() < 5.0


def test_feedback_has_the_joints_on_their_way(gripper: Gripper) -> None:
    goal = gripper.send(0.02)
    assert goal is not None
    assert goal.end()[0] == SUCCEEDED
    positions = [one.state.position[0] for one in goal.feedback]
    assert positions[0] > positions[-1]
    assert any(0.03 < position < 0.05 for position in positions)


def test_an_effort_is_the_force_on_an_object(gripper: Gripper, daemon: Daemon) -> None:
    daemon.put_object(30.0)
    status, result = gripper.go(0.0, effort_n=10.0)
    assert (status, result.reached_goal, result.stalled) == (SUCCEEDED, False, True)
    assert near(result.state.position[0], 0.03, 0.001)
    assert daemon.state()["force_set_n"] == 10.0
    gripper.ros.spin_until(lambda: near(gripper.new_state().effort[0], 10.0, 1.5), "10 N")
    gripper.ros.spin_until(lambda: gripper.held and gripper.held[-1], "it is held")


def test_another_effort_changes_the_force_of_what_is_held(gripper: Gripper, daemon: Daemon) -> None:
    daemon.put_object(30.0)
    assert gripper.go(0.0, effort_n=10.0)[0] == SUCCEEDED
    status, result = gripper.go(0.0, effort_n=5.0)
    assert (status, result.stalled) == (SUCCEEDED, True)
    assert daemon.state()["force_set_n"] == 5.0


def test_without_an_object_an_effort_reaches_the_position_and_goes_no_further(
    gripper: Gripper, daemon: Daemon
) -> None:
    status, result = gripper.go(0.02, effort_n=10.0)
    assert (status, result.reached_goal, result.stalled) == (SUCCEEDED, True, False)
    assert near(daemon.state()["opening_mm"], 20.0, 1.0)


def test_an_effort_closes_no_further_than_the_position_also_far_open(
    gripper: Gripper, daemon: Daemon
) -> None:
    status, result = gripper.go(0.045, effort_n=8.0)
    assert (status, result.reached_goal, result.stalled) == (SUCCEEDED, True, False)
    assert near(daemon.state()["opening_mm"], 45.0, 1.5)
    assert gripper.go(0.06)[0] == SUCCEEDED
    daemon.put_object(50.0)
    status, result = gripper.go(0.045, effort_n=8.0)
    assert (status, result.reached_goal, result.stalled) == (SUCCEEDED, False, True)
    assert near(result.state.position[0], 0.05, 0.001)
    assert daemon.state()["force_set_n"] == 8.0


def test_a_move_that_something_blocks_is_aborted_and_stalled(
    gripper: Gripper, daemon: Daemon
) -> None:
    daemon.put_object(40.0)
    status, result = gripper.go(0.01)
    assert (status, result.reached_goal, result.stalled) == (ABORTED, False, True)


def test_the_older_action_does_the_same(gripper: Gripper, daemon: Daemon) -> None:
    daemon.put_object(25.0)
    goal = gripper.send_legacy(0.0, 12.0)
    assert goal is not None
    status, result = goal.end()
    assert (status, result.reached_goal, result.stalled) == (SUCCEEDED, False, True)
    assert near(result.position, 0.025, 0.001)
    assert daemon.state()["force_set_n"] == 12.0
    assert goal.feedback
    daemon.remove_object()
    goal = gripper.send_legacy(0.05)
    assert goal is not None
    status, result = goal.end()
    assert (status, result.reached_goal) == (SUCCEEDED, True)


def test_a_cancelled_goal_holds_the_jaws(gripper: Gripper, daemon: Daemon) -> None:
    goal = gripper.send(0.0, velocity_m_s=0.01)
    assert goal is not None
    gripper.ros.spin_until(lambda: gripper.new_state().position[0] < 0.058, "the jaws move")
    took_s = goal.cancel()
    status, result = goal.end()
    assert status == CANCELED
    assert result.state.position[0] > 0.04
    assert daemon.state()["mode"] == "holding"
    print(f"cancelled after {took_s * 1000:.0f} ms")


def test_a_goal_that_is_cancelled_at_once_moves_nothing(gripper: Gripper, daemon: Daemon) -> None:
    goal = gripper.send(0.0)
    assert goal is not None
    goal.cancel()
    assert goal.end()[0] == CANCELED
    assert daemon.state()["opening_mm"] > 50.0


def test_a_newer_goal_replaces_the_older_one(gripper: Gripper) -> None:
    older = gripper.send(0.0, velocity_m_s=0.01)
    between = gripper.send(0.01, velocity_m_s=0.01)
    newer = gripper.send(0.05)
    assert older is not None
    assert between is not None
    assert newer is not None
    assert older.end()[0] == ABORTED
    assert between.end()[0] == ABORTED
    status, result = newer.end()
    assert (status, result.reached_goal) == (SUCCEEDED, True)
    assert near(result.state.position[0], 0.05, 0.001)


def test_a_goal_that_cannot_be_read_is_rejected(gripper: Gripper) -> None:
    assert gripper.send(0.02, names=("another_joint",)) is None
    assert gripper.send(float("nan")) is None
    assert gripper.process.said("no joint of this gripper in another_joint")


def test_release_opens_a_little(gripper: Gripper, daemon: Daemon) -> None:
    daemon.put_object(30.0)
    gripper.go(0.0, effort_n=10.0)
    answer = gripper.call("release")
    assert answer.success, answer.message
    assert near(gripper.new_state().position[0], 0.04, 0.001)


def test_the_joints_of_the_vendors_urdf(start) -> None:
    names = ("gripper_slide_joint_right", "gripper_slide_joint_left")
    _, gripper = start("/named_by_layout", names=names, joint_layout="slides")
    assert tuple(gripper.new_state().name) == names
    names = ("right_jaw", "left_jaw")
    daemon, gripper = start(names=names, joint_layout="slides", joint_names="[right_jaw, left_jaw]")
    state = gripper.new_state()
    assert tuple(state.name) == names
    opening_mm = daemon.state()["opening_mm"]
    assert near(state.position[0], 0.042726 - opening_mm / 2000.0, 0.0002)
    assert gripper.call("enable").success
    status, result = gripper.go(0.042726)  # closed
    assert near(daemon.state()["opening_mm"], 0.0, 1.5), (status, result)
    status, result = gripper.go(0.0)  # open, by the URDF's travel
    assert (status, result.reached_goal) == (SUCCEEDED, True)
    assert near(daemon.state()["opening_mm"], 85.452, 1.0)
    assert list(result.state.position) == [result.state.position[0]] * 2
