"""The gripper at its daemon, for as long as the node is configured: on asyncio, without any ROS.

A `Driver` connects, and connects again when the daemon is gone; it hands out every new state,
carries out one goal at a time, of which the newest wins, and follows set-points between goals.
The daemon decides and moves; nothing is enabled by itself after a new connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Coroutine
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from litegrip_client import ConnectError, GraspResult, GripperState, LiteGripError, MotionConfig
from litegrip_client.aio import LiteGrip, SetpointStream

from . import diagnosis, orders
from .diagnosis import Diagnosis
from .joints import Scale, Target, within_travel
from .orders import Ending, Outcome, Plan

RETRY_S = 0.5
"""Between two attempts to reach a daemon."""
STOP_LEVELS = ("hold", "relax", "disable")
REACH_S = 2.0
"""So long a request waits for a connection that is being made."""
DIAGNOSE_S = 1.0
SAY_AGAIN_S = 5.0
"""A refusal of set-points for the same reason is reported again after so long."""
_KINDS = ("object_lost", "released_by_fault", "weak", "pressing", "heat", "stop", "calibration")


@dataclass(frozen=True)
class Settings:
    """What the node's parameters say of the gripper."""

    channel: str | None
    socket_path: str | None = None
    rate_hz: float = 50.0
    disable_on_disconnect: bool = True
    allow_stalling: bool = False
    stop_level: Literal["hold", "relax", "disable"] = "hold"
    stream_valid_s: float = 0.2
    stream_speed_mm_s: float | None = None
    """How fast the jaws follow set-points without a velocity; None leaves it to the daemon."""
    release_mm: float = 10.0


class Listener(Protocol):
    """Who is told; always from the driver's event loop."""

    def on_state(self, state: GripperState, scale: Scale | None) -> None:
        """Take a state whose feedback is newer than that of the state before."""

    def on_diagnosis(self, what: Diagnosis) -> None:
        """Take how the gripper is, about once a second."""

    def inform(self, text: str) -> None:
        """Take what went well."""

    def warn(self, text: str) -> None:
        """Take what somebody should look at."""


class Goal:
    """One goal on its way."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self.task: asyncio.Task[Any] | None = None
        self.ended_by: Outcome | None = None
        """Why it was ended from outside."""


class Driver:
    """One gripper. All methods are for the event loop that runs `run`."""

    def __init__(self, settings: Settings, listener: Listener) -> None:
        self._settings = settings
        self._listener = listener
        self._gripper: LiteGrip | None = None
        self.state: GripperState | None = None
        """The newest one, None without a daemon."""
        self.scale: Scale | None = None
        """That of the calibration in use, None without."""
        self._goal: Goal | None = None
        self._turn = asyncio.Lock()
        self._stream: SetpointStream | None = None
        self._stream_speed_mm_s: float | None = None
        self._setpoint: Target | None = None
        self._has_setpoint = asyncio.Event()
        self._said: dict[str, float] = {}
        self._refused = ""
        self._away = ""
        """Why no daemon answers; empty while one does, and before the first attempt."""
        self._gives_back = False
        """True while `disable` has closed the connection, with which the lease ends."""
        self._is_decided = asyncio.Event()
        """Set once it is known whether a daemon answers."""

    # The connection

    async def run(self) -> None:
        """Stay connected until cancelled; then disconnect, as `disable_on_disconnect` says."""
        settings = self._settings
        while True:
            gripper = LiteGrip(
                settings.channel,
                socket_path=settings.socket_path,
                disable_on_disconnect=settings.disable_on_disconnect,
                voice=orders.in_ros,
            )
            try:
                async with gripper:
                    await self._serve(gripper)
            except LiteGripError as error:
                is_news = self._gripper is gripper or not self._away
                if is_news and not self._gives_back:
                    self._away = error.message
                    self._is_decided.set()
                    self._listener.warn(f"{error.message}; trying again")
            finally:
                self._gives_back = False
                self._gripper = self.state = self.scale = self._stream = self._setpoint = None
            if self._away:
                self._listener.on_diagnosis(diagnosis.of_no_daemon(self._away, self._refused))
                await asyncio.sleep(RETRY_S)

    async def _serve(self, gripper: LiteGrip) -> None:
        self.scale = Scale.from_info(await gripper.info())
        self._gripper = gripper
        self._is_decided.set()
        if self._away:
            self._listener.inform(f"the daemon of {gripper.channel} answers again")
        else:
            self._listener.inform(f"connected to the daemon of {gripper.channel}")
        self._away = ""
        await _until_one_ends(
            self._watch(gripper),
            self._hear(gripper),
            self._diagnose(gripper),
            self._follow(gripper),
        )

    async def _watch(self, gripper: LiteGrip) -> None:
        async for state in gripper.states(self._settings.rate_hz):
            before, self.state = self.state, state
            is_new = before is None or state.feedback_s != before.feedback_s
            if is_new and state.feedback_s is not None:
                self._listener.on_state(state, self.scale)

    async def _hear(self, gripper: LiteGrip) -> None:
        async with gripper.events(_KINDS) as events:
            async for event in events:
                if event.kind == "calibration":
                    self.scale = Scale.from_info(await gripper.info())
                    self._listener.inform(event.message)
                else:
                    self._listener.warn(event.message)

    async def _diagnose(self, gripper: LiteGrip) -> None:
        while True:
            health = await gripper.health()
            self._listener.on_diagnosis(diagnosis.of_gripper(health, self.state, self._refused))
            await asyncio.sleep(DIAGNOSE_S)

    async def _reach(self) -> LiteGrip:
        """Return the connected gripper; wait for a connection that is just being made."""
        if not self._is_decided.is_set():
            # `asyncio.wait_for` may lose a cancelling that comes together with what it waits for.
            waiting = asyncio.ensure_future(self._is_decided.wait())
            try:
                await asyncio.wait([waiting], timeout=REACH_S)
            finally:
                waiting.cancel()
        if self._gripper is None:
            why = self._away or "it does not answer yet"
            raise ConnectError(f"no daemon: {why}", reason="no_daemon")
        return self._gripper

    # Goals

    def accept(self, goal: Goal) -> None:
        """Let a goal take the place of the one before; `go` then carries it out."""
        before, self._goal = self._goal, goal
        if before is not None:
            self.end(before, Outcome(Ending.ABORTED, why="a newer goal came", reason="replaced"))

    async def go(self, goal: Goal) -> Outcome:
        """Carry out an accepted goal, once the one before has ended; its end in any case."""
        goal.task = asyncio.current_task()
        try:
            if goal.ended_by is not None:
                return goal.ended_by
            async with self._turn:
                return await self._carry_out(goal.target)
        except asyncio.CancelledError:
            if goal.ended_by is None:
                raise
            return goal.ended_by
        except LiteGripError as error:
            outcome = orders.of_error(error)
            self._refused = outcome.why
            return outcome
        finally:
            if self._goal is goal:
                self._goal = None

    def end(self, goal: Goal, outcome: Outcome) -> None:
        """End a goal from outside: the jaws hold."""
        if goal.ended_by is None:
            goal.ended_by = outcome
            if goal.task is not None:
                goal.task.cancel()

    def cancel(self, goal: Goal) -> None:
        """End a goal as its client wants."""
        self.end(goal, Outcome(Ending.CANCELED, why="cancelled", reason="cancelled"))

    def end_all(self) -> None:
        """End what moves, because the node is no longer active."""
        self._setpoint = None
        if self._goal is not None:
            why = "the node was deactivated"
            self.end(self._goal, Outcome(Ending.ABORTED, why=why, reason="deactivated"))

    async def _carry_out(self, target: Target) -> Outcome:
        gripper = await self._reach()
        await self._end_stream()
        scale = Scale.from_info(await gripper.info())
        if scale is None:  # the daemon says it better
            return orders.of_move(await gripper.goto(target.opening_mm), allow_stalling=False)
        target = Target(
            within_travel(target.opening_mm, scale.travel_mm), target.speed_mm_s, target.force_n
        )
        opening_mm = (await gripper.get_state()).opening_mm
        plan = orders.plan(target, opening_mm, scale.travel_mm)
        if plan.margin is not None:
            return orders.of_grasp(await self._grasp(gripper, plan))
        if plan.speed_mm_s is None:
            moved = await gripper.goto(plan.opening_mm, duration=None)
        else:
            moved = await gripper.move_at_speed(plan.opening_mm, plan.speed_mm_s)
        return orders.of_move(moved, allow_stalling=self._settings.allow_stalling)

    async def _grasp(self, gripper: LiteGrip, plan: Plan) -> GraspResult:
        gripper.motion_config.margin = plan.margin or 0.0
        try:
            return await gripper.grasp(plan.force_n, speed_mm_s=plan.speed_mm_s, until="verdict")
        finally:
            gripper.motion_config = MotionConfig()

    # Set-points

    def follow(self, target: Target) -> None:
        """Take a set-point; the newest wins.

        It counts for nothing while a goal runs, and without a daemon: one that comes back later
        must not move the jaws by it.
        """
        if self._gripper is not None:
            self._setpoint = target
            self._has_setpoint.set()

    async def _follow(self, gripper: LiteGrip) -> None:
        while True:
            await self._has_setpoint.wait()
            self._has_setpoint.clear()
            target, self._setpoint = self._setpoint, None
            if target is None:
                continue
            if self._goal is not None:
                self._say_seldom("goal", "joint_commands count for nothing while a goal runs")
                continue
            try:
                async with self._turn:
                    await self._send(gripper, target)
            except ConnectError:
                raise
            except LiteGripError as error:
                self._stream = None
                self._refused = orders.refusal(error)
                self._say_seldom(error.reason or "", f"joint_commands: {self._refused}")

    async def _send(self, gripper: LiteGrip, target: Target) -> None:
        scale, opening_mm, torque_nm = self.scale, target.opening_mm, None
        if scale is not None:
            opening_mm = within_travel(opening_mm, scale.travel_mm)
            torque_nm = None if target.force_n is None else scale.torque_nm(target.force_n)
        speed_mm_s = target.speed_mm_s or self._settings.stream_speed_mm_s
        if self._stream is None or speed_mm_s != self._stream_speed_mm_s:
            self._stream = gripper.stream(self._settings.stream_valid_s, speed_mm_s=speed_mm_s)
            self._stream_speed_mm_s = speed_mm_s
        await self._stream.set_target(opening_mm, torque_nm=torque_nm)

    async def _end_stream(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            await stream.close()

    def _say_seldom(self, key: str, text: str) -> None:
        now_s = time.monotonic()
        if now_s - self._said.get(key, -SAY_AGAIN_S) >= SAY_AGAIN_S:
            self._said[key] = now_s
            self._listener.warn(text)

    # What the services do. Each returns what came of it, for a person; raises `LiteGripError`.

    async def stop(self) -> str:
        """Stop, whoever moves the gripper, until `clear`."""
        state = await (await self._reach()).software_stop(
            self._settings.stop_level, "~/stop in ROS"
        )
        return f"stopped ({(state.stop or {}).get('level')})"

    async def clear(self) -> str:
        """Clear a stop, and the motor's fault; enable nothing."""
        gripper = await self._reach()
        state = await gripper.clear_stop()
        if state.mode == "fault":
            await gripper.clear_fault(enable=False)
        return "cleared"

    async def enable(self) -> str:
        """Enable the motor, which takes the lease."""
        result = await (await self._reach()).enable()
        if not result.ok:
            raise LiteGripError(result.message or "not enabled", reason=result.reason)
        return "enabled"

    async def disable(self) -> str:
        """Disable the motor, and give the lease back."""
        gripper = await self._reach()
        if not await gripper.disable():
            raise LiteGripError("the motor did not confirm it", reason="not_confirmed")
        self._gives_back = True
        self._is_decided.clear()
        await gripper.disconnect()
        return "disabled"

    async def release(self) -> str:
        """Open a little, at most to the end of the travel, to let go."""
        state = await (await self._reach()).get_state()
        if state.opening_mm is None:
            raise LiteGripError("the opening is not known", reason="motor_silent")
        opening_mm = state.opening_mm + self._settings.release_mm
        if self.scale is not None:
            opening_mm = min(opening_mm, self.scale.travel_mm)
        goal = Goal(Target(opening_mm))
        self.accept(goal)
        outcome = await self.go(goal)
        if outcome.ending is not Ending.SUCCEEDED:
            raise LiteGripError(outcome.why, reason=outcome.reason)
        return "released"

    def note_refusal(self, text: str) -> None:
        """Keep a refusal for the diagnosis."""
        self._refused = text


async def _until_one_ends(*parts: Coroutine[Any, Any, None]) -> None:
    """Run all; when one ends, end the others and raise its error."""
    tasks = [asyncio.ensure_future(part) for part in parts]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*tasks, return_exceptions=True)
    for task in tasks:
        if not task.cancelled() and (error := task.exception()) is not None:
            raise error
