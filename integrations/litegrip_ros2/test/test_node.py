"""The node among others: states, set-points, a daemon that dies, two grippers, its life."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from importlib.util import module_from_spec, spec_from_file_location
from itertools import pairwise
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree as ET

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from processes import Daemon, Gripper, Ros, near, program, wait
from rclpy.time import Time
from sensor_msgs.msg import JointState

from litegrip_ros2.node import PARAMETERS

SUCCEEDED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_ABORTED
HERE = Path(__file__).resolve().parent


def stamp_s(state: JointState) -> float:
    return Time.from_msg(state.header.stamp).nanoseconds / 1e9


def test_states_come_at_their_rate_with_the_motors_time_at_little_cost(gripper: Gripper) -> None:
    gripper.new_state()
    gripper.states.clear()
    cpu_s, begun_s = gripper.process.cpu_s(), time.monotonic()
    ages_s: list[float] = []

    def have_come() -> bool:
        ages_s.extend(time.time() - stamp_s(one) for one in gripper.states[len(ages_s) :])
        return len(ages_s) >= 500

    gripper.ros.spin_until(have_come, "500 states")
    took_s = time.monotonic() - begun_s
    share = (gripper.process.cpu_s() - cpu_s) / took_s
    stamps = [stamp_s(one) for one in gripper.states]
    assert all(later > earlier for earlier, later in pairwise(stamps))
    ages_s.sort()
    print(
        f"{len(stamps) / took_s:.1f} states a second, CPU {share * 100:.1f} % of a core,"
        f" age at the reader p50 {ages_s[250] * 1e3:.1f} ms, p99 {ages_s[494] * 1e3:.1f} ms"
    )
    mean_s = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    assert 0.015 < mean_s < 0.05
    assert -0.001 < ages_s[250] < 0.5


def test_set_points_are_followed_and_a_goal_comes_first(gripper: Gripper) -> None:
    target_m = 0.06

    def lead() -> bool:
        nonlocal target_m
        target_m = max(target_m - 0.0005, 0.03)
        message = JointState(name=["an_arm", *gripper.names], position=[1.0, target_m])
        gripper.commands.publish(message)
        return near(gripper.new_state().position[0], 0.03, 0.001)

    gripper.ros.spin_until(lead, "the jaws follow to 30 mm")
    assert gripper.go(0.05)[0] == SUCCEEDED

    goal = gripper.send(0.07, velocity_m_s=0.01)
    assert goal is not None
    for _ in range(20):
        lead()
    gripper.ros.spin_until(
        lambda: gripper.process.said("count for nothing while a goal runs"), "it is said"
    )
    status, result = goal.end()
    assert (status, result.reached_goal) == (SUCCEEDED, True)


def test_what_is_refused_of_set_points_is_said_once(gripper: Gripper) -> None:
    assert gripper.call("disable").success
    for _ in range(50):
        gripper.commands.publish(JointState(name=[*gripper.names], position=[0.03]))
        gripper.new_state()
    assert len(gripper.process.said("joint_commands: .*~/enable")) == 1


def test_an_object_that_is_lost_is_told(gripper: Gripper, daemon: Daemon) -> None:
    daemon.put_object(30.0)
    assert gripper.go(0.0, effort_n=10.0)[0] == SUCCEEDED
    gripper.ros.spin_until(lambda: gripper.held and gripper.held[-1], "it is held")
    daemon.remove_object()
    gripper.ros.spin_until(lambda: not gripper.held[-1], "it is lost")
    gripper.ros.spin_until(lambda: gripper.process.said("WARN.*lost"), "the log says so")


def test_a_fault_of_the_motor_is_told_and_cleared(gripper: Gripper, daemon: Daemon) -> None:
    daemon.fault("overload")
    gripper.is_healthy(2, "overload")
    status, _ = gripper.go(0.02)
    assert status == ABORTED
    assert gripper.call("clear").success
    assert gripper.call("enable").success
    assert gripper.go(0.05)[0] == SUCCEEDED


def test_a_daemon_that_is_killed_and_comes_back(start) -> None:
    daemon, gripper = start()
    gripper.new_state()
    assert gripper.call("enable").success
    goal = gripper.send(0.0, velocity_m_s=0.005)
    assert goal is not None
    daemon.kill()
    assert goal.end()[0] == ABORTED
    gripper.is_healthy(2, "no daemon")
    answer = gripper.call("enable")
    assert not answer.success
    assert "no daemon" in answer.message
    status, _ = gripper.go(0.02)
    assert status == ABORTED
    daemon.start()
    gripper.is_healthy(0)
    gripper.new_state()
    assert daemon.state()["enabled"] is False  # it is not enabled behind anybody's back
    assert gripper.call("enable").success
    assert gripper.go(0.03)[0] == SUCCEEDED
    assert gripper.process.said("answers again")


def test_two_grippers_in_two_namespaces(start) -> None:
    one, left = start("/left")
    other, right = start("/right")
    for gripper in (left, right):
        gripper.new_state()
        assert gripper.call("enable").success
    goals = left.send(0.02), right.send(0.05)
    for goal in goals:
        assert goal is not None
        assert goal.end()[0] == SUCCEEDED
    assert near(one.state()["opening_mm"], 20.0, 1.0)
    assert near(other.state()["opening_mm"], 50.0, 1.0)
    assert near(left.new_state().position[0], 0.02, 0.001)
    assert near(right.new_state().position[0], 0.05, 0.001)
    assert left.call("stop").success
    assert right.go(0.06)[0] == SUCCEEDED
    names = {left.is_healthy(1).name, right.is_healthy(0).name}
    assert names == {"/left/gripper: gripper", "/right/gripper: gripper"}


def test_its_life_is_managed(start, ros: Ros) -> None:
    daemon, gripper = start(autostart=False)
    name = gripper.process.name
    change = ros.node.create_client(ChangeState, f"{name}/change_state")
    get = ros.node.create_client(GetState, f"{name}/get_state")
    ros.spin_until(change.service_is_ready, "the node is there")

    def to(transition: int, label: str) -> None:
        change.call_async(ChangeState.Request(transition=Transition(id=transition)))
        ros.spin_until(lambda: ros.ask(get, GetState.Request()).current_state.label == label, label)

    for _ in range(2):  # a node that was cleaned up works again
        to(Transition.TRANSITION_CONFIGURE, "inactive")
        gripper.is_healthy(0)
        assert not gripper.states
        assert gripper.send(0.02) is None
        to(Transition.TRANSITION_ACTIVATE, "active")
        gripper.new_state()
        assert gripper.call("enable").success
        assert gripper.go(0.03)[0] == SUCCEEDED
        goal = gripper.send(0.06, velocity_m_s=0.005)
        assert goal is not None
        to(Transition.TRANSITION_DEACTIVATE, "inactive")
        assert goal.end()[0] == ABORTED
        assert daemon.state()["mode"] == "holding"
        to(Transition.TRANSITION_CLEANUP, "unconfigured")
        assert daemon.state()["enabled"] is False
        gripper.states.clear()
    to(Transition.TRANSITION_CONFIGURE, "inactive")
    to(Transition.TRANSITION_ACTIVATE, "active")
    assert gripper.call("enable").success
    assert gripper.send(0.06, velocity_m_s=0.005) is not None
    to(Transition.TRANSITION_ACTIVE_SHUTDOWN, "finalized")
    assert daemon.state()["enabled"] is False


@pytest.mark.parametrize(("disables", "enabled"), [(True, False), (False, True)])
def test_its_end_disables_the_motor_or_holds(start, disables: bool, enabled: bool) -> None:
    daemon, gripper = start(disable_on_disconnect=disables, enable_on_activate=True)
    gripper.ros.spin_until(lambda: daemon.state()["enabled"], "the motor is enabled")
    assert gripper.process.end() == 0
    assert daemon.state()["enabled"] is enabled


def test_by_a_simulated_clock_states_come_also_before_it_ticks(start) -> None:
    _, gripper = start(use_sim_time=True)
    assert stamp_s(gripper.new_state()) == 0.0


def test_it_may_start_before_the_daemon(start) -> None:
    daemon, gripper = start("/late", is_late=True, enable_on_activate=True)
    node = gripper.process
    wait(lambda: node.said("trying again"), "it looks for the daemon")
    daemon.start()
    wait(lambda: daemon.state()["enabled"], "the motor is enabled")
    daemon.kill()
    daemon.start()
    wait(lambda: node.said("answers again")[1:], "it is connected again")
    assert daemon.state()["enabled"] is False


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("rate_hz:=500.0", "0.1 to 200"),
        ("joint_layout:=both", "opening or slides"),
        ("closed_position:=0.0", "above 0"),
        ("stop_level:=softly", "hold, relax or disable"),
    ],
)
def test_a_wrong_parameter_is_named(wrong: str, says: str) -> None:
    command = [program(), "--ros-args", "-p", wrong]
    got = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert got.returncode == os.EX_CONFIG
    assert says in got.stderr


def test_the_launch_file_names_what_the_node_has(monkeypatch: pytest.MonkeyPatch) -> None:
    """With stand-ins for launch and launch_ros, which are not on PyPI."""
    made: list[dict[str, object]] = []

    def stand_in(name: str, **names: object) -> None:
        module = ModuleType(name)
        vars(module).update(names)
        monkeypatch.setitem(sys.modules, name, module)

    def node(**arguments: object) -> SimpleNamespace:
        made.append(arguments)
        return SimpleNamespace()

    stand_in("launch", LaunchDescription=list)
    stand_in("launch.actions", DeclareLaunchArgument=lambda name, **_: name)
    stand_in("launch.substitutions", LaunchConfiguration=lambda name: name)
    stand_in("launch_ros")
    stand_in("launch_ros.actions", LifecycleNode=node)
    stand_in("launch_ros.parameter_descriptions", ParameterValue=lambda name, **_: name)
    spec = spec_from_file_location("gripper_launch", HERE.parent / "launch/gripper.launch.py")
    assert spec is not None
    assert spec.loader is not None
    launch = module_from_spec(spec)
    spec.loader.exec_module(launch)
    described = launch.generate_launch_description()
    [arguments] = made
    [given] = arguments["parameters"]  # type: ignore[misc]
    assert set(given) <= set(PARAMETERS)
    assert set(given) | {"namespace", "name"} == {one for one in described if isinstance(one, str)}
    assert arguments["executable"] == "litegrip_node"
    for name, (default, kind, _) in launch.ARGUMENTS.items():
        read = kind(default) if kind is not bool else default == "true"
        assert read == PARAMETERS[name]


def test_the_xacro_names_topics_and_joints_of_the_node(tmp_path: Path) -> None:
    macro = HERE.parent / "urdf/litegrip.ros2_control.xacro"
    robot = tmp_path / "robot.xacro"
    robot.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:include filename="{macro}"/>'
        '<xacro:litegrip_ros2_control name="one" node="/gripper"/>'
        '<xacro:litegrip_ros2_control name="two" node="/left/gripper" layout="slides"'
        ' prefix="left_"/></robot>'
    )
    made = subprocess.run(["xacro", str(robot)], capture_output=True, text=True, check=True).stdout
    one, two = ET.fromstring(made).findall("ros2_control")
    assert [joint.get("name") for joint in one.findall("joint")] == ["gripper_opening_joint"]
    assert [joint.get("name") for joint in two.findall("joint")] == [
        "left_gripper_slide_joint_right",
        "left_gripper_slide_joint_left",
    ]
    topics = {row.get("name"): row.text for row in two.iterfind("hardware/param")}
    assert topics == {
        "joint_commands_topic": "/left/gripper/joint_commands",
        "joint_states_topic": "/left/gripper/joint_states",
    }
    assert re.search("JointStateTopicSystem", made)
