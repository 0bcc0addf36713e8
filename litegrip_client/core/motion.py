"""Motions, which are cancelled when their caller is interrupted, and streams of set-points.

A set-point is a target that a program sends again and again; each is valid for a short time. This
module sends it and finds out what became of it. The daemon decides how the jaws follow.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Awaitable, Callable, Mapping

from litegrip_client.core.session import AsyncBlock, DaemonSession, own_jobs
from litegrip_client.line.exchange import FOREVER_S, LEFT_ALONE, Call, Progress, not_answered
from litegrip_client.values.checks import RANGES, given_numbers, in_range, number
from litegrip_client.values.errors import (
    BusyError,
    CancelledError,
    CommandError,
    ConnectError,
    LeaseError,
    LiteGripError,
    ParameterError,
    StoppedError,
)
from litegrip_client.values.fields import Hinting
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.warn import leave, warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.session import Wire

_CANCEL_TIMEOUT_S = 2.0


class Motion:
    """One motion, to be run once.

    After an interrupt, `cancelled` is the job from the daemon's answer to the cancelling,
    and `cancel_error` why cancelling failed; both None when nothing was left to cancel.
    """

    def __init__(
        self,
        wire: Wire,
        method: str,
        params: Mapping[str, Any],
        on_progress: Progress | None = None,
        *,
        warns: bool = True,
    ) -> None:
        """With `warns`, a failed cancelling is logged."""
        self.cancelled: dict[str, Any] | None = None
        self.cancel_error: LiteGripError | None = None
        self._is_over = False
        self._wire = wire
        self._method = method
        # Always with progress, because that gives the number of the job.
        self._params = {**params, "progress": True}
        self._on_progress = on_progress
        self._warns = warns

    async def run(self) -> dict[str, Any]:
        """Wait for the motion's result, however long it takes.

        If something else ends the waiting (KeyboardInterrupt, a cancelled task, an error of the
        progress callback), the motion is cancelled, so that the jaws hold, and that is raised.
        """
        wire = self._wire
        call = wire.connection.prepare_guarded(self._method, self._params, self._on_progress)
        call.keep = True
        try:
            return await wire.run(call, FOREVER_S)
        except GeneratorExit:  # the event loop is gone, and nothing can be awaited
            raise
        except BaseException as error:
            if call.answered or not call.is_sent:
                raise
            try:
                if isinstance(error, ConnectError) and error.reason == "connection_lost":
                    error.message += f": {LEFT_ALONE}"
                if isinstance(error, ConnectError) and wire.connection.is_silent:
                    self._cancel_later(call)
                else:
                    await wire.finish(lambda: self._cancel(call))
            except GeneratorExit:
                raise
            except BaseException:  # another interrupt: nobody waits for the cancelling any more
                if not self._is_over:
                    self._cancel_later(call)
                raise
            raise
        finally:
            wire.connection.forget(call)

    async def _cancel(self, call: Call) -> None:
        connection = self._wire.connection
        if connection.closed:
            self.cancel_error = ConnectError("the daemon is gone", reason="connection_lost")
            return
        try:
            number = call.job if call.job is not None else await self._find_job(call)
            # By now this motion may have ended, and what runs may be another's.
            if number is not None and not call.answered:
                params = {"job": number}
                self.cancelled = await self._wire.call("job.cancel", params, _CANCEL_TIMEOUT_S)
        except LiteGripError as error:
            self.cancel_error = error
            if connection.is_silent:
                error.message = not_answered(_CANCEL_TIMEOUT_S)
                connection.note_silence(is_danger_told=True)
            if self._warns:
                from litegrip_client.values.voices import in_python  # noqa: PLC0415 - seldom needed

                name = (connection.voice or in_python)(self._method, None, None) or self._method
                warn(f"the interrupted {name} could not be cancelled: {error.message}")
        self._is_over = True

    def _cancel_later(self, call: Call) -> None:
        """Have the motion cancelled when the daemon goes on, and somebody reads its answer."""
        connection = self._wire.connection

        def cancel(result: dict[str, Any]) -> None:
            for job in own_jobs(connection, result["jobs"]):
                connection.post("job.cancel", {"job": job})

        with contextlib.suppress(LiteGripError):  # why the waiting ended is what counts
            if call.job is not None:
                connection.post("job.cancel", {"job": call.job})
            else:
                connection.post("job.list", {}, cancel)

    async def _find_job(self, call: Call) -> int | None:
        """Find the running job of this connection: no notification has named its number yet."""
        listed = (await self._wire.call("job.list", None, _CANCEL_TIMEOUT_S))["jobs"]
        running = [job for job in listed if job["state"] == "running"]
        own = own_jobs(self._wire.connection, running)
        if own:
            return own[0]
        if running and not call.answered:
            numbers = ", ".join(str(job["job"]) for job in running)
            raise CommandError(
                f"job {numbers} runs, but not as a job of process {os.getpid()}",
                reason="unknown_job",
            )
        return None


_LOOK_S = 0.1


async def stay(session: DaemonSession, generation: int, seconds: float) -> None:
    """Wait while the jaws do what a request has begun, whose answer told of the stop `generation`.

    What would end a motion ends this at once, by the same error: a stop, the loss of the lease,
    the motor's fault, the daemon's end. After `cancel` the jaws hold, as after that of a motion.
    """
    wire, cancels = session.wire, session.cancels
    ends_s = time.monotonic() + seconds
    session.waits += 1
    try:
        while (left_s := ends_s - time.monotonic()) > 0.0:
            await session.pause(min(left_s, _LOOK_S))
            if session.cancels != cancels:
                with contextlib.suppress(BusyError):  # then a next motion has begun
                    await session.command("motion.hold", {})
                raise CancelledError("this was cancelled, by cancel()", reason="cancelled")
            await _check_course(wire, generation)
    except ConnectError as error:
        if error.reason == "connection_lost":
            error.message += f": {LEFT_ALONE}"
        raise
    finally:
        session.waits -= 1


async def _check_course(wire: Wire, generation: int) -> None:
    """Raise what a motion would end with by now."""
    try:
        await wire.call("lease.renew")
    except LeaseError as error:
        if error.reason != "lease_lost" or "cause" in error.data:  # else nobody has one
            raise
    state = await wire.call("state.get")
    if state["stop_generation"] != generation or state["motor"] != "enabled":
        # The daemon says why best, by a refusal: this it does not carry out any more.
        await wire.call("motion.hold", {"stop_generation": generation})


_OF_THE_TARGET = ("invalid_params", "out_of_limits")
"""What is wrong with a target itself; all else ends the stream, whatever it was sent."""

_EXPIRED = "set_point_expired"
"""A target that came too late, on a busy machine say: the next one takes its place."""


@shortened
class SetpointStream(AsyncBlock, Hinting):
    """A stream of targets for the jaws: `async with gripper.stream() as stream:`.

    The latest target wins, of whichever stream of the program. When none comes for `valid_s`, and
    at the end of the block, the jaws hold where they are. Each object is for one thread or task.
    Without a block it works until `close`; after that, or the block, `set_target` raises
    `ConnectError`.

    The first target, and one after a pause, waits for the daemon's answer; the others are sent
    without. What the daemon refuses of those is raised by one of the next calls, at the latest by
    `close` or the end of the block, but for one that came too late: the jaws hold until the next
    one. After `cancel` of the gripper the next call raises `CancelledError`, and the one after that
    begins anew.
    """

    def __init__(
        self,
        session: DaemonSession,
        valid_s: float,
        limits: dict[str, Any],
        before: Callable[[], Awaitable[None]] | None = None,
        *,
        is_told_at_end: bool = True,
        tuned: str | None = None,
    ) -> None:
        """`before` is awaited once, before the first target is sent.

        Unless `is_told_at_end`, `close` raises no refusal of a target: it must hinder nothing.
        `tuned` is the limit that comes from `motion_config`, if one does.
        """
        self._session = session
        self._valid_s = in_range("valid_s", valid_s, *RANGES["valid_s"])
        self._limits = limits
        self._before = before
        self._is_told_at_end = is_told_at_end
        self._tuned = tuned
        self._wire: Wire | None = None
        self._job: int | None = None
        self._asks = False
        self._sent_s = -math.inf
        self._cancels = 0
        self._is_closed = False

    def __repr__(self) -> str:
        bounds = (f"{name}={self._limits.get(name)}" for name in ("speed_mm_s", "torque_nm"))
        given = [one for one in bounds if not one.endswith("=None")]
        what = ", ".join([f"valid_s={self._valid_s}", *given])
        end = ", closed" if self._is_closed else ""
        return f"<SetpointStream to {self._session.channel}, {what}{end}>"

    async def set_target(
        self,
        opening_mm: float | None = None,
        *,
        position_rad: float | None = None,
        openness: float | None = None,
        push_nm: float | None = None,
        torque_nm: float | None = None,
        kp: float | None = None,
        kd: float | None = None,
    ) -> None:
        """Send the jaws to exactly one of `opening_mm`, `position_rad` and `openness` (0 to 1).

        Or have the motor make the torque `push_nm` in N·m, positive towards larger radians, within
        what `set_force` allows and at a bounded speed; with 0 the jaws are slack. Nothing else goes
        with it.

        `torque_nm` is for this target what it is for the whole stream. `kp` (5 to 500 N·m/rad) and
        `kd` (0.1 to 5 N·m·s/rad) are the most stiffness and damping, the calibration's by default.
        Raises `CommandError` (a target outside the travel, another motion runs, ...) and all that
        motions raise: for the first target at once, for others by a later call, `close` included.
        The call that raises sends nothing: send its target again.
        """
        if self._is_closed:
            raise self._ended()
        target = given_numbers(
            opening_mm=opening_mm, position_rad=position_rad, openness=openness, push_nm=push_nm
        )
        if len(target) != 1:
            given = " and ".join(target) or "none"
            raise ParameterError(
                "a target is exactly one of opening_mm, position_rad, openness and push_nm, each a"
                f" number; given: {given}",
                reason="invalid_params",
            )
        own = given_numbers(torque_nm=torque_nm, kp=kp, kd=kd)
        limits = self._limits if push_nm is None else _only_calibration(self._limits)
        if self._before is not None:
            before, self._before = self._before, None
            await before()
        try:
            await self._send({**target, "valid_s": self._valid_s, **limits, **own})
        except ParameterError as error:
            if error.data.get("parameter") == self._tuned is not None:
                from litegrip_client.values.voices import setting_right  # noqa: PLC0415 - an error

                error.message = f"motion_config: {error.message}"
                error.data.setdefault("hint", setting_right(self._tuned))
            raise

    def _ended(self) -> ConnectError:
        stream = self._session.voice("stream.set", None, None)
        return ConnectError(
            "this stream takes no target: its block has ended, or it was closed",
            reason="not_connected",
            data={"hint": f"begin a new one: {stream}"} if stream else {},
        )

    async def _send(self, params: dict[str, Any]) -> None:
        wire = self._session.wire
        paused_s = time.monotonic() - self._sent_s
        cancels, self._cancels = self._cancels, self._session.cancels
        if cancels != self._cancels and self._wire is not None and paused_s < self._valid_s:
            self._wire = self._job = None
            raise CancelledError("this stream was cancelled, by cancel()", reason="cancelled")
        is_heard = wire is not self._wire or self._asks  # else something may be refused by now
        if not is_heard:
            await self._raise_refusal(wire)
        # Also after half of the validity: the job that it began may have ended on its way.
        if is_heard or self._asks or paused_s >= self._valid_s / 2.0:
            self._asks = True
            try:
                call = wire.connection.prepare_guarded("stream.set", params)
                job = (await wire.run(call))["job"]
            except StoppedError as error:
                if not is_heard:
                    self._say_stopped(error)
                raise
            self._wire, self._job, self._asks = wire, job, False
            self._sent_s = time.monotonic()
            if is_heard:
                await wire.take_refusal()  # another's, or of what was sent before one was raised
            else:
                await self._raise_refusal(wire)
        else:
            await wire.notify_guarded("stream.set", params)
            self._sent_s = time.monotonic()

    async def _raise_refusal(self, wire: Wire) -> None:
        """Raise why a target that was sent before was refused, if one was."""
        refusal = await wire.take_refusal()
        if refusal is not None:
            self._asks = True
        if refusal is not None and refusal.reason != _EXPIRED:
            if refusal.reason in _OF_THE_TARGET:
                refusal.message = f"of an earlier target: {refusal.message}"
            elif not self._say_stopped(refusal):
                refusal.message = f"the stream was broken off: {refusal.message}"
            raise refusal

    def _say_stopped(self, error: LiteGripError) -> bool:
        """Have the error say that a stop ended the stream; return False if it knows of none.

        The daemon speaks of a request that came too late, which is to be sent again. Of a stream
        that is no news, and old targets are not sent again.
        """
        if error.reason != "sent_before_stop" or "level" not in error.data:
            return False
        owner, why = error.owner or {}, error.data.get("why")
        by = f"{owner['program']} (pid {owner['pid']})" if owner else "the daemon"
        stop = f"a stop ({error.data['level']}) by {by}{f': {why}' if why else ''}"
        error.message = f"the stream was broken off: {stop}"
        if "stop.clear" in error.named:
            clear = self._session.voice("stop.clear", None, None)
            error.data["hint"] = clear or "stop.clear"
        else:
            error.data["hint"] = "that stop is cleared: when it is safe, send the next target"
        return True

    async def close(self) -> None:
        """End the stream at once, so that the jaws hold; again does nothing.

        Raises why a target was refused, if no call has raised it.
        """
        self._is_closed = True
        wire, job = self._wire, self._job
        self._wire = self._job = None
        if wire is None or wire.connection.closed:
            return
        if time.monotonic() - self._sent_s < 2.0 * self._valid_s:
            await wire.call("job.cancel", {"job": job})
        if self._is_told_at_end and not self._asks:
            await self._raise_refusal(wire)

    async def __aenter__(self) -> SetpointStream:
        return self

    async def __aexit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        await leave(self.close, error)


def _only_calibration(limits: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a stream's limits goes with a torque."""
    return {name: value for name, value in limits.items() if name == "calibration"}


def frame_target(q: float, kp: float, kd: float, dq: float, tau: float) -> dict[str, float]:
    """Return the set-point that stands for an MIT frame; raises `CommandError` if none can."""
    given = {"q": q, "kp": kp, "kd": kd, "dq": dq, "tau": tau}
    values = {name: number(name, value) for name, value in given.items()}
    for gain in ("kp", "kd"):
        if values[gain] < 0.0:
            text = f"{gain} is {values[gain]:g}, a gain cannot be negative"
            raise ParameterError(text, reason="invalid_params", data={"parameter": gain})
    if values["kp"] > 0.0:
        if values["tau"] != 0.0:
            raise _unsupported(
                "a frame with kp and tau asks for a torque beside a position", _FORCES
            )
        return {"position_rad": values["q"], "kp": values["kp"], "kd": values["kd"]}
    if values["kd"] > 0.0 and values["dq"] != 0.0:
        hint = "move_at_speed(target_mm, speed_mm_s)"
        raise _unsupported("a frame with kp = 0, kd and dq asks for a speed", hint)
    return {"push_nm": values["tau"]}


def check_no_feedforward(method: str, **given: float) -> None:
    """Raise `CommandError` for a velocity or torque (by name) that is not 0."""
    for name, value in given.items():
        if number(name, value) != 0.0:
            asked = "a torque" if name.startswith("tau") else "a velocity"
            hint = _FORCES if name.startswith("tau") else "a duration, or move_at_speed()"
            raise _unsupported(f"{method} with {name} = {value:g} asks for {asked}", hint)


_FORCES = "set_force(force_n), grasp(force_n=...), or stream(torque_nm=...) to bound it"


def _unsupported(what: str, hint: str) -> CommandError:
    return CommandError(
        f"{what}: the daemon computes velocity and torque itself",
        reason="unsupported",
        data={"hint": f"use {hint}"},
    )
