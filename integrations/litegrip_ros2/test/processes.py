"""The daemon and the node as processes, and ROS as a third one sees it."""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from control_msgs.action import GripperCommand, ParallelGripperCommand
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from litegrip_client.line.connection import Connection
from litegrip_client.testing import SimulatedDaemon

WITHIN_S = 30.0
"""For what comes soon on an idle machine."""
CONFIG = f"""
[bus]
interface = "litegrip_sim"
watchdog_s = 0.4
[access]
gateways = [{os.getuid()}]
operators = [{os.getuid()}]
"""
MOUNT = '\n[gripper]\nmount = "normal"\n'


SHARED, LEFT, RIGHT = NAMES = "shared", "left", "right"
"""Grippers, each of which one daemon at a time is."""


@dataclass(frozen=True)
class Place:
    """Where nodes meet grippers: by the daemons' sockets in a folder, or by a portal's names."""

    folder: Path
    environment: dict[str, str] = field(default_factory=dict)
    """What a node has in addition; with a portal, where its sockets are."""

    def parameters(self, name: str) -> dict[str, str]:
        """Return what a node is given to meet a gripper."""
        if self.environment:
            return {"channel": f"lab.{name}"}
        return {"channel": self.channel(name), "socket_path": self.socket_path(name)}

    def channel(self, name: str) -> str:
        return f"ros{os.getpid()}-{name}"

    def socket_path(self, name: str) -> str:
        return str(self.folder / f"{name}.sock")


@contextlib.contextmanager
def here(folder: Path) -> Iterator[Place]:
    yield Place(folder)


@contextlib.contextmanager
def through_a_portal(folder: Path) -> Iterator[Place]:
    """Run router, gateway and portal before the daemons, by the Python that has them."""
    command = [str(Path(os.environ["LITEGRIPD"]).with_name("python")), "-m"]
    with subprocess.Popen(
        [*command, "tests.integrations.ros2.portal", str(folder), *NAMES],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
        env=_alone(),
    ) as process:
        said = process.stdout.readline().strip()
        assert Path(said).is_dir(), said
        yield Place(folder, {"XDG_RUNTIME_DIR": said})
        said = process.communicate(timeout=3.0 * WITHIN_S)[0]
    assert process.returncode == 0, said


def _alone() -> dict[str, str]:
    """Return the environment of what has nothing to do with ROS."""
    return {name: os.environ[name] for name in ("PATH", "LANG") if name in os.environ}


class Daemon(SimulatedDaemon):
    """A daemon that can be killed and started again."""

    def __init__(
        self, place: Place, folder: Path, name: str, *, is_calibrated: bool = True
    ) -> None:
        folder.mkdir()
        super().__init__(place.channel(name), place.socket_path(name))
        self.place = place
        self.name = name
        self.folder = folder
        (folder / "config.toml").write_text(CONFIG + (MOUNT if is_calibrated else ""))
        self.start()

    def start(self) -> None:
        command = [os.environ["LITEGRIPD"], self.channel, "--socket", self.socket_path]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(
                [*command, "--config", str(self.folder / "config.toml")],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**_alone(), "STATE_DIRECTORY": str(self.folder), "HOME": str(self.folder)},
            )
        wait(self.answers, f"{self.channel} serves")

    def answers(self) -> bool:
        with contextlib.suppress(OSError, ConnectionError), Connection(self.socket_path) as one:
            one.call("hello", {"client": "test"})
            return True
        return False

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(WITHIN_S)

    def state(self) -> dict[str, Any]:
        return self._call("state.get")


def wait(ready: Callable[[], Any], what: str, within_s: float = WITHIN_S) -> Any:
    """Wait until `ready` returns something true; return it."""
    ends_s = time.monotonic() + within_s
    while not (got := ready()):
        assert time.monotonic() < ends_s, f"in {within_s:g} s it was not so: {what}"
        time.sleep(0.01)
    return got


def program() -> str:
    """Return where colcon has installed the node."""
    prefix = os.environ["AMENT_PREFIX_PATH"].split(":")[0]
    return str(Path(prefix, "lib", "litegrip_ros2", "litegrip_node"))


class NodeProcess:
    """The installed node, as `ros2 run litegrip_ros2 litegrip_node` starts it."""

    def __init__(self, log: Path, daemon: Daemon, namespace: str = "", **parameters: Any) -> None:
        given = {**daemon.place.parameters(daemon.name), **parameters}
        arguments = [f"{name}:={_yaml(value)}" for name, value in given.items()]
        command = [program(), "--ros-args", "-r", f"__ns:={namespace or '/'}"]
        for argument in arguments:
            command += ["-p", argument]
        self.name = f"{namespace}/gripper"
        self.log = log
        with log.open("ab") as output:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, **daemon.place.environment},
            )

    def said(self, pattern: str) -> list[str]:
        """Return the lines of its log in which a pattern is found."""
        lines = self.log.read_text(errors="replace").splitlines()
        return [line for line in lines if re.search(pattern, line)]

    def cpu_s(self) -> float:
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def end(self) -> int:
        """Interrupt it as Ctrl-C does; return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(WITHIN_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise


def _yaml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


class Ros:
    """A client in a process of its own: this one."""

    def __init__(self) -> None:
        self.node = Node(f"test_{os.getpid()}")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def spin_until(self, ready: Callable[[], Any], what: str, within_s: float = WITHIN_S) -> Any:
        ends_s = time.monotonic() + within_s
        while not (got := ready()):
            assert time.monotonic() < ends_s, f"in {within_s:g} s it was not so: {what}"
            self.executor.spin_once(timeout_sec=0.05)
        return got

    def result(self, future: Any, what: str) -> Any:
        self.spin_until(future.done, what)
        return future.result()

    def ask(self, client: Any, request: Any) -> Any:
        """Call a service, again if nothing comes.

        Fast DDS drops an answer to a client that the server has not discovered in time; the server
        then only prints a warning.
        """
        self.spin_until(client.service_is_ready, f"{client.srv_name} is there")
        for _ in range(6):
            future, ends_s = client.call_async(request), time.monotonic() + WITHIN_S / 6.0
            self.spin_until(lambda: future.done() or time.monotonic() > ends_s, "an answer")  # noqa: B023
            if future.done():
                return future.result()
        raise AssertionError(f"{client.srv_name} does not answer")

    def gripper(self, node: NodeProcess, names: tuple[str, ...] = ()) -> Gripper:
        return Gripper(self, node, names or ("gripper_opening_joint",))

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()


class Goal:
    """A goal that was accepted."""

    def __init__(self, ros: Ros, handle: Any, feedback: list[Any]) -> None:
        self._ros = ros
        self._handle = handle
        self._ended = handle.get_result_async()
        self.feedback = feedback

    def end(self) -> tuple[int, Any]:
        """Wait for its end; return status and result."""
        got = self._ros.result(self._ended, "the goal has ended")
        return got.status, got.result

    def cancel(self) -> float:
        """Ask for its cancelling; return the seconds until its end."""
        begun_s = time.monotonic()
        self._handle.cancel_goal_async()
        self.end()
        return time.monotonic() - begun_s


class Gripper:
    """What one node offers, from outside."""

    def __init__(self, ros: Ros, process: NodeProcess, names: tuple[str, ...]) -> None:
        self.ros, self.process, self.names = ros, process, names
        node, name = ros.node, process.name
        self.states: list[JointState] = []
        self.held: list[bool] = []
        self.health: list[DiagnosticStatus] = []
        self._made = [
            node.create_subscription(JointState, f"{name}/joint_states", self.states.append, 10),
            node.create_subscription(
                Bool,
                f"{name}/object_held",
                lambda message: self.held.append(message.data),
                QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            ),
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_health, 10),
        ]
        self.commands = node.create_publisher(JointState, f"{name}/joint_commands", 1)
        self._parallel = ActionClient(node, ParallelGripperCommand, f"{name}/gripper_cmd")
        self._legacy = ActionClient(node, GripperCommand, f"{name}/gripper_cmd_legacy")
        self._services: dict[str, Any] = {}

    def _on_health(self, message: DiagnosticArray) -> None:
        self.health += [one for one in message.status if one.name.startswith(self.process.name)]

    def close(self) -> None:
        node = self.ros.node
        for one in self._made:
            node.destroy_subscription(one)
        for service in self._services.values():
            node.destroy_client(service)
        self._parallel.destroy()
        self._legacy.destroy()
        node.destroy_publisher(self.commands)

    def call(self, name: str) -> Trigger.Response:
        """Call a service of the node's."""
        if name not in self._services:
            self._services[name] = self.ros.node.create_client(
                Trigger, f"{self.process.name}/{name}"
            )
        return self.ros.ask(self._services[name], Trigger.Request())

    def new_state(self) -> JointState:
        """Wait for joint states from now on; return the first."""
        self.states.clear()
        return self.ros.spin_until(lambda: self.states and self.states[-1], "joint states come")

    def is_healthy(self, level: int, message: str = "") -> DiagnosticStatus:
        """Wait for a status of this level, whose text has the message; return it."""

        def found() -> DiagnosticStatus | None:
            rows = [one for one in self.health if one.level == bytes([level])]
            return next((one for one in rows if message in one.message), None)

        self.health.clear()
        return self.ros.spin_until(found, f"a status of level {level}, {message!r}")

    def send(
        self,
        position_m: float,
        *,
        velocity_m_s: float | None = None,
        effort_n: float | None = None,
        names: tuple[str, ...] | None = None,
    ) -> Goal | None:
        """Send a goal; return it if it was accepted."""
        names = self.names if names is None else names
        count = max(len(names), 1)
        command = JointState(name=list(names), position=[position_m] * count)
        command.velocity = [] if velocity_m_s is None else [velocity_m_s] * count
        command.effort = [] if effort_n is None else [effort_n] * count
        return self._send(self._parallel, ParallelGripperCommand.Goal(command=command))

    def send_legacy(self, position_m: float, max_effort_n: float = 0.0) -> Goal | None:
        """Send a goal of the older action; return it if it was accepted."""
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = position_m, max_effort_n
        return self._send(self._legacy, goal)

    def _send(self, client: Any, goal: Any) -> Goal | None:
        self.ros.spin_until(client.server_is_ready, "the action is there")
        feedback: list[Any] = []
        future = client.send_goal_async(goal, lambda one: feedback.append(one.feedback))
        handle = self.ros.result(future, "the goal was taken or not")
        return Goal(self.ros, handle, feedback) if handle.accepted else None

    def go(self, position_m: float, **more: Any) -> tuple[int, Any]:
        """Send a goal that must be accepted; return status and result."""
        goal = self.send(position_m, **more)
        assert goal is not None
        return goal.end()


def near(value: float, expected: float, within: float) -> bool:
    """Return True if a value is known and near."""
    return math.isfinite(value) and abs(value - expected) <= within


@contextlib.contextmanager
def context() -> Iterator[Ros]:
    """Use ROS for the length of a block."""
    rclpy.init()
    ros = Ros()
    try:
        yield ros
    finally:
        ros.close()
        rclpy.try_shutdown()
