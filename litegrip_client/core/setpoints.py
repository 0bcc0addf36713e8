"""Set-points: targets that a program sends again and again, each valid for a short time only.

This module sends them and finds out what became of them; how the jaws follow is the daemon's.
"""

from __future__ import annotations

import math
import time
from collections.abc import Awaitable, Callable
from types import TracebackType

from litegrip_client.checks import given_numbers, number
from litegrip_client.core.session import DaemonSession
from litegrip_client.errors import CommandError, ParameterError
from litegrip_client.warn import leave

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.wire import Wire

_EXPIRED = "set_point_expired"
"""A target that came too late, on a busy machine say: the next one takes its place."""


class SetpointStream:
    """A stream of targets for the jaws: `async with gripper.stream() as stream:`.

    The latest target wins. When none comes for `valid_s`, and at the end of the block, the jaws
    hold where they are. Each object is for one thread or task.

    The first target, and one after a pause, waits for the daemon's answer; the others are sent
    without. What the daemon refuses of those is raised by one of the next calls, but for one that
    came too late: the jaws hold until the next one.
    """

    def __init__(
        self,
        session: DaemonSession,
        valid_s: float,
        limits: dict[str, Any],
        before: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        """`before` is awaited once, before the first target is sent."""
        self._session = session
        self._valid_s = number("valid_s", valid_s)
        self._limits = limits
        self._before = before
        self._wire: Wire | None = None
        self._job: int | None = None
        self._sent_s = -math.inf

    async def set_target(
        self,
        opening_mm: float | None = None,
        *,
        position_rad: float | None = None,
        openness: float | None = None,
        torque_nm: float | None = None,
        kp: float | None = None,
        kd: float | None = None,
    ) -> None:
        """Send the jaws to exactly one of `opening_mm`, `position_rad` and `openness` (0 to 1).

        `torque_nm` is for this target what it is for the whole stream. `kp` (5 to 500 N·m/rad) and
        `kd` (0.1 to 5 N·m·s/rad) are the most stiffness and damping, the calibration's by default.
        Raises `CommandError` (a target outside the travel, another motion runs, ...) and all that
        motions raise.
        """
        target = given_numbers(opening_mm=opening_mm, position_rad=position_rad, openness=openness)
        if len(target) != 1:
            raise ParameterError(
                "a set-point needs exactly one of opening_mm, position_rad and openness",
                reason="invalid_params",
            )
        own = given_numbers(torque_nm=torque_nm, kp=kp, kd=kd)
        if self._before is not None:
            before, self._before = self._before, None
            await before()
        await self._send({**target, "valid_s": self._valid_s, **self._limits, **own})

    async def _send(self, params: dict[str, Any]) -> None:
        wire = self._session.wire
        paused_s = time.monotonic() - self._sent_s
        if wire is self._wire and paused_s < self._valid_s / 2.0:
            refusal = await wire.take_refusal()
            if refusal is not None:
                self._wire = self._job = None
            if refusal is not None and refusal.reason != _EXPIRED:
                raise refusal
        if wire is self._wire and paused_s < self._valid_s / 2.0:
            await wire.notify_guarded("stream.set", params)
        else:
            # Also after half of the validity: the job that it began may have ended on its way.
            self._wire = self._job = None
            job = (await wire.run(wire.prepare_guarded("stream.set", params)))["job"]
            await wire.take_refusal()  # of what was sent before, and is answered by now
            self._wire, self._job = wire, job
        self._sent_s = time.monotonic()

    async def close(self) -> None:
        """End the stream at once, so that the jaws hold; nothing to do when it ended by itself."""
        wire, job = self._wire, self._job
        self._wire = self._job = None
        lives = time.monotonic() - self._sent_s < 2.0 * self._valid_s
        if wire is not None and job is not None and lives and not wire.closed:
            await wire.call("job.cancel", {"job": job})

    async def __aenter__(self) -> SetpointStream:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await leave(self.close, error)


def frame_target(q: float, kp: float, kd: float, dq: float, tau: float) -> dict[str, float]:
    """Return the target that stands for an MIT frame; raises `CommandError` if none can."""
    given = {"q": q, "kp": kp, "kd": kd, "dq": dq, "tau": tau}
    values = {name: number(name, value) for name, value in given.items()}
    for gain in ("kp", "kd"):
        if values[gain] < 0.0:
            text = f"{gain} is {values[gain]:g}, a gain cannot be negative"
            raise ParameterError(text, reason="invalid_params", data={"parameter": gain})
    if values["tau"] != 0.0:
        raise _unsupported("a frame with tau asks for a torque", _FORCES)
    if values["kp"] == 0.0:
        what, hint = "loose jaws", "zero_gravity()"
        if values["dq"] != 0.0:
            what, hint = "a speed", "move_at_speed(target_mm, speed_mm_s)"
        raise _unsupported(f"a frame with kp = 0 asks for {what}", hint)
    return {"position_rad": values["q"], "kp": values["kp"], "kd": values["kd"]}


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
