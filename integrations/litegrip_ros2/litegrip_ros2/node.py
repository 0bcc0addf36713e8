"""The node: topics, actions, services and diagnostics of one gripper, by rclpy.

The executor's thread serves ROS, a second thread runs the driver's event loop. What comes from the
driver is published by its thread; what goes to it is handed over by `call_soon_threadsafe`.
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
import traceback
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from litegrip_client import GripperState, LiteGripError
from litegrip_client.aio import LiteGrip

from . import orders
from .diagnosis import Diagnosis
from .driver import RETRY_S, STOP_LEVELS, Driver, Goal, Settings
from .joints import CLOSED_M, DEFAULT_NAMES, Joints, Layout, Scale, Target, UnusableError
from .orders import Ending, Outcome

try:
    from control_msgs.action import GripperCommand, ParallelGripperCommand
except ImportError:  # control_msgs before 5.1, as in Humble, has only the older one
    from control_msgs.action import GripperCommand

    ParallelGripperCommand = None

END_WITHIN_S = 10.0
"""So long the driver may take to disable the motor and to disconnect."""


class GripperNode(LifecycleNode):
    """One gripper; docs/ros2.md has its topics, actions, services and parameters."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("gripper", **arguments)
        for name, default in PARAMETERS.items():
            self.declare_parameter(name, default)
        self._loop: asyncio.AbstractEventLoop | None = None
        self.has_failed = False
        """True once the driver has ended by a mistake of ours."""
        self._is_active = False
        self._entities: list[Callable[[], None]] = []
        self._goals: dict[bytes, tuple[Goal, Any, Callable[[JointState], Any]]] = {}
        self._was_held: bool | None = None

    # Its life

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters, offer everything, and look for the daemon."""
        try:
            self._joints = self._read_joints()
            settings = self._read_settings()
            self._channel = LiteGrip(settings.channel).channel
        except (ValueError, LiteGripError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._states = self.create_lifecycle_publisher(JointState, "~/joint_states", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._held = self.create_lifecycle_publisher(Bool, "~/object_held", latched)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        commands = self.create_subscription(
            JointState, "~/joint_commands", self._on_command, newest
        )
        self._entities = [
            partial(self.destroy_publisher, self._states),
            partial(self.destroy_publisher, self._held),
            partial(self.destroy_publisher, self._diagnostics),
            partial(self.destroy_subscription, commands),
        ]
        self._start(settings)
        for kind, name, reads, writes in self._actions():
            server = ActionServer(
                self,
                kind,
                name,
                execute_callback=partial(self._execute, writes),
                goal_callback=partial(self._admit, reads),
                handle_accepted_callback=partial(self._accept, reads, writes),
                cancel_callback=self._cancel,
            )
            self._entities.append(server.destroy)
        for name in ("stop", "clear", "enable", "disable", "release"):
            act = getattr(self._driver, name)
            service = self.create_service(Trigger, f"~/{name}", partial(self._serve, name, act))
            self._entities.append(partial(self.destroy_service, service))
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish, and take goals and set-points; enable the motor if a parameter says so."""
        self._is_active = True
        self._was_held = None
        if self.get_parameter("enable_on_activate").value:
            self._post(self._enable_once())
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take nothing more; the jaws hold. Lease and motor stay as they are."""
        self._is_active = False
        self._tell(self._driver.end_all)
        return super().on_deactivate(state)

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect, and offer nothing more."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """As `on_cleanup`."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """As `on_cleanup`."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Disconnect from the daemon; again does nothing."""
        self._is_active = False
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.call_soon_threadsafe(self._driver.end_all)
            loop.call_soon_threadsafe(self._running.cancel)
            self._thread.join(END_WITHIN_S)
        for destroy in self._entities:
            destroy()
        self._entities = []

    # The driver's thread

    def _start(self, settings: Settings) -> None:
        begun = threading.Event()

        async def main() -> None:
            self._loop = asyncio.get_running_loop()
            self._driver = Driver(settings, self)
            self._running = asyncio.ensure_future(self._driver.run())
            begun.set()
            try:
                await self._running
            except asyncio.CancelledError:
                pass
            except Exception:  # noqa: BLE001 - a node that only looks alive is worse
                self._loop = None
                if self.context.ok():  # else it was interrupted while it published
                    self.has_failed = True
                    self.get_logger().fatal(traceback.format_exc())
                    self.context.try_shutdown()

        self._thread = threading.Thread(target=asyncio.run, args=(main(),), daemon=True)
        self._thread.start()
        begun.wait()

    def _post(self, coroutine: Coroutine[Any, Any, Any]) -> Future:
        """Run a coroutine in the driver's loop; return the executor's future of its result."""
        executor, loop = self.executor, self._loop
        future = Future(executor=executor)

        async def run() -> None:
            try:
                future.set_result(await coroutine)
            except asyncio.CancelledError:
                future.set_exception(LiteGripError("the node is ending"))
            except Exception as error:  # noqa: BLE001 - whoever awaits it gets it
                future.set_exception(error)
            if executor is not None:
                executor.wake()  # nothing else tells it that the future is done

        if loop is None:
            coroutine.close()
            future.set_exception(LiteGripError("the node is not configured"))
        else:
            asyncio.run_coroutine_threadsafe(run(), loop)
        return future

    def _tell(self, act: Callable[..., None], *arguments: Any) -> None:
        """Call something in the driver's loop, in the order of these calls."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(act, *arguments)

    async def _enable_once(self) -> None:
        """Enable the motor, as soon as there is a daemon."""
        while self._is_active:
            try:
                self.inform(await self._driver.enable())
                return
            except LiteGripError as error:  # noqa: PERF203 - twice a second
                if not orders.has_not_arrived(error):
                    self.warn(f"enable_on_activate: {orders.refusal(error)}")
                    return
                await asyncio.sleep(RETRY_S)

    # From the driver, in its thread

    def on_state(self, state: GripperState, scale: Scale | None) -> None:
        """Publish a state, and what it means for the running goal."""
        message = self._joint_state(state, scale)
        if not self._is_active or message is None:
            return
        self._states.publish(message)
        for _, handle, feedback in list(self._goals.values()):
            handle.publish_feedback(feedback(message))
        is_held = state.is_grasped is True
        if is_held is not self._was_held:
            self._was_held = is_held
            self._held.publish(Bool(data=is_held))

    def on_diagnosis(self, what: Diagnosis) -> None:
        """Publish how the gripper is."""
        status = DiagnosticStatus(
            level=bytes([what.level]),
            name=f"{self.get_fully_qualified_name()}: gripper",
            message=what.message,
            hardware_id=f"litegrip {self._channel}",
            values=[KeyValue(key=key, value=value) for key, value in what.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def inform(self, text: str) -> None:
        """Log what went well."""
        self.get_logger().info(text)

    def warn(self, text: str) -> None:
        """Log what somebody should look at."""
        self.get_logger().warning(text)

    def _joint_state(self, state: GripperState, scale: Scale | None) -> JointState | None:
        """Return the joints as the motor last reported them; None where nothing is known."""
        stamp_s = state.timestamp
        if state.opening_mm is None or stamp_s is None or scale is None:
            return None
        joints = self._joints
        count = len(joints.names)
        clock = self.get_clock()
        stamp_ns = round(stamp_s * 1e9)
        if clock.ros_time_is_active:  # simulated: 0 until it ticks
            stamp_ns = max(clock.now().nanoseconds - (time.time_ns() - stamp_ns), 0)
        velocity_m_s = joints.velocity_m_s(scale.opening_mm_s(state.velocity_rad_s or 0.0))
        message = JointState(
            name=list(joints.names),
            position=[joints.position_m(state.opening_mm)] * count,
            velocity=[velocity_m_s] * count,
            effort=[state.force_n or 0.0] * count,
        )
        message.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
        return message

    # From ROS, in the executor's thread

    def _actions(self) -> list[tuple[Any, str, Callable[[Any], Target], _Writes]]:
        rows: list[tuple[Any, str, Callable[[Any], Target], _Writes]] = [
            (GripperCommand, "~/gripper_cmd_legacy", self._read_legacy, _Legacy())
        ]
        if ParallelGripperCommand is None:
            self.warn("this control_msgs has no ParallelGripperCommand: ~/gripper_cmd is missing")
        else:
            rows.append((ParallelGripperCommand, "~/gripper_cmd", self._read, _Parallel()))
        return rows

    def _read(self, request: Any) -> Target:
        command = request.command
        return self._joints.target(command.name, command.position, command.velocity, command.effort)

    def _read_legacy(self, request: Any) -> Target:
        command = request.command
        first = self._joints.names[:1]
        return self._joints.target(first, [command.position], [], [command.max_effort])

    def _admit(self, reads: Callable[[Any], Target], request: Any) -> GoalResponse:
        """Reject what cannot be read; what the daemon refuses is aborted, with the reason."""
        try:
            if not self._is_active:
                raise UnusableError("the node is not active")
            reads(request)
        except UnusableError as error:
            self.warn(f"goal rejected: {error}")
            self._driver.note_refusal(str(error))
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accept(self, reads: Callable[[Any], Target], writes: _Writes, handle: Any) -> None:
        """Note a goal before anything can happen to it: its turn to be executed comes later."""
        goal = Goal(reads(handle.request))
        self._goals[bytes(handle.goal_id.uuid)] = goal, handle, writes.feedback
        self._tell(self._driver.accept, goal)
        handle.execute()

    def _cancel(self, handle: Any) -> CancelResponse:
        running = self._goals.get(bytes(handle.goal_id.uuid))
        if running is not None:
            self._tell(self._driver.cancel, running[0])
        return CancelResponse.ACCEPT

    async def _execute(self, writes: _Writes, handle: Any) -> Any:
        identity = bytes(handle.goal_id.uuid)
        goal, _, _ = self._goals[identity]
        try:
            outcome: Outcome = await self._post(self._driver.go(goal))
        finally:
            del self._goals[identity]
        if outcome.ending is Ending.SUCCEEDED:
            handle.succeed()
        elif outcome.ending is Ending.CANCELED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
            say = self.inform if outcome.reason == "replaced" else self.warn
            say(f"goal aborted: {outcome.why}")
        return writes.result(outcome, self._joints_at(outcome.state or self._driver.state))

    def _joints_at(self, state: GripperState | None) -> JointState:
        """Return the joints of a state; empty where nothing is known."""
        message = None if state is None else self._joint_state(state, self._driver.scale)
        return message or JointState()

    def _on_command(self, message: JointState) -> None:
        if not self._is_active:
            return
        try:
            target = self._joints.target(
                message.name, message.position, message.velocity, message.effort
            )
        except UnusableError as error:
            self.get_logger().warning(f"joint_commands: {error}", throttle_duration_sec=5.0)
            return
        self._tell(self._driver.follow, target)

    async def _serve(
        self,
        name: str,
        act: Callable[[], Coroutine[Any, Any, str]],
        _request: Any,
        response: Any,
    ) -> Any:
        try:
            response.message = await self._post(act())
            response.success = True
        except LiteGripError as error:
            response.message = orders.refusal(error)
            self.warn(f"{name}: {response.message}")
        return response

    # Parameters

    def _read_joints(self) -> Joints:
        layouts = [one.value for one in Layout]
        if self._value("joint_layout") not in layouts:
            raise ValueError(f"joint_layout must be {' or '.join(layouts)}")
        layout = Layout(self._value("joint_layout"))
        names = tuple(self._value("joint_names")) or DEFAULT_NAMES[layout]
        if names == ("",):  # how launch files write an empty list of texts
            names = DEFAULT_NAMES[layout]
        return Joints(layout, names, self._value("closed_position"))

    def _read_settings(self) -> Settings:
        rate_hz = self._value("rate_hz")
        if not 0.1 <= rate_hz <= 200.0:
            raise ValueError(f"rate_hz is {rate_hz:g}, it must be 0.1 to 200")
        if self._value("stop_level") not in STOP_LEVELS:
            raise ValueError("stop_level must be hold, relax or disable")
        return Settings(
            channel=self._value("channel") or None,
            socket_path=self._value("socket_path") or None,
            rate_hz=rate_hz,
            disable_on_disconnect=self._value("disable_on_disconnect"),
            allow_stalling=self._value("allow_stalling"),
            stop_level=self._value("stop_level"),
            stream_valid_s=self._value("stream_valid_s"),
            stream_speed_mm_s=self._value("stream_speed") * 1000.0 or None,
            release_mm=self._value("release_distance") * 1000.0,
        )

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value


PARAMETERS: dict[str, Any] = {
    "channel": "",
    "socket_path": "",
    "rate_hz": 50.0,
    "joint_layout": "opening",
    "joint_names": [""],
    "closed_position": CLOSED_M,
    "autostart": True,
    "enable_on_activate": False,
    "disable_on_disconnect": True,
    "allow_stalling": False,
    "stop_level": "hold",
    "stream_valid_s": 0.2,
    "stream_speed": 0.0,
    "release_distance": 0.01,
}
"""All parameters and their defaults: SI units, read when the node is configured."""


class _Writes:
    """How an action's results and feedback are written."""

    def result(self, outcome: Outcome, joints: JointState) -> Any:
        raise NotImplementedError

    def feedback(self, joints: JointState) -> Any:
        raise NotImplementedError


class _Parallel(_Writes):
    def result(self, outcome: Outcome, joints: JointState) -> Any:
        return ParallelGripperCommand.Result(
            state=joints, stalled=outcome.stalled, reached_goal=outcome.reached_goal
        )

    def feedback(self, joints: JointState) -> Any:
        return ParallelGripperCommand.Feedback(state=joints)


class _Legacy(_Writes):
    def result(self, outcome: Outcome, joints: JointState) -> Any:
        return GripperCommand.Result(
            **_first(joints), stalled=outcome.stalled, reached_goal=outcome.reached_goal
        )

    def feedback(self, joints: JointState) -> Any:
        return GripperCommand.Feedback(**_first(joints))


def _first(joints: JointState) -> dict[str, float]:
    """Return position and effort of the first joint; the others are the same."""
    if not joints.position:
        return {"position": float("nan"), "effort": 0.0}
    return {"position": joints.position[0], "effort": joints.effort[0]}


def main(arguments: list[str] | None = None) -> int:
    """Run one node until it is interrupted."""
    rclpy.init(args=arguments)
    node = GripperNode()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        if node.get_parameter("autostart").value:
            if node.trigger_configure() is not TransitionCallbackReturn.SUCCESS:
                return os.EX_CONFIG
            node.trigger_activate()
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.close()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return os.EX_SOFTWARE if node.has_failed else 0
