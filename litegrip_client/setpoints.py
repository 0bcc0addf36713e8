"""Set-points: targets that a program sends again and again, each valid for a short time only.

This module sends them and finds out what became of them; how the jaws follow is the daemon's.
"""

from __future__ import annotations

import math
import time
from types import TracebackType

from litegrip_client.base import ActionBase
from litegrip_client.checks import given_numbers, number
from litegrip_client.connection import Connection
from litegrip_client.errors import CommandError
from litegrip_client.link import Link
from litegrip_client.warn import leave

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

_FRAME_VALID_S = 0.2
_CONTACT_TORQUE_NM = 1.0
"""What the jaws press with at most, following set-points, when nothing else is asked for."""


class SetpointStream:
    """A stream of targets for the jaws: `with gripper.stream() as stream:`.

    The latest target wins. When none comes for `valid_s`, and at the end of the block, the jaws
    hold where they are. Each object is for one thread.

    The first target, and one after a pause, waits for the daemon's answer; the others are sent
    without. What the daemon refuses of those is raised by one of the next calls.
    """

    def __init__(self, link: Link, valid_s: float, limits: dict[str, Any]) -> None:
        self._link = link
        self._valid_s = number("valid_s", valid_s)
        self._limits = limits
        self._connection: Connection | None = None
        self._job: int | None = None
        self._sent_s = -math.inf

    def set_target(
        self,
        opening_mm: float | None = None,
        *,
        position_rad: float | None = None,
        openness: float | None = None,
        torque_nm: float | None = None,
    ) -> None:
        """Send the jaws to exactly one of `opening_mm`, `position_rad` and `openness` (0 to 1).

        `torque_nm` is for this target what it is for the whole stream. Raises `CommandError` (a
        target outside the travel, another motion runs, ...) and all that motions raise.
        """
        target = given_numbers(opening_mm=opening_mm, position_rad=position_rad, openness=openness)
        if len(target) != 1:
            raise CommandError(
                "a set-point needs exactly one of opening_mm, position_rad and openness",
                reason="invalid_params",
            )
        own = given_numbers(torque_nm=torque_nm)
        self._send({**target, "valid_s": self._valid_s, **self._limits, **own})

    def _send(self, params: dict[str, Any]) -> None:
        connection = self._link.connection
        paused_s = time.monotonic() - self._sent_s
        if connection is self._connection and paused_s < self._valid_s / 2.0:
            refusal = connection.take_refusal()
            if refusal is not None:
                self._connection = self._job = None
                raise refusal
            connection.notify_guarded("stream.set", params)
        else:
            # Also after half of the validity: the job that it began may have ended on its way.
            self._connection = self._job = None
            job = connection.run(connection.prepare_guarded("stream.set", params))["job"]
            connection.take_refusal()  # of what was sent before, and is answered by now
            self._connection, self._job = connection, job
        self._sent_s = time.monotonic()

    def close(self) -> None:
        """End the stream at once, so that the jaws hold; nothing to do when it ended by itself."""
        connection, job = self._connection, self._job
        self._connection = self._job = None
        lives = time.monotonic() - self._sent_s < 2.0 * self._valid_s
        if connection is not None and job is not None and lives and not connection.closed:
            connection.call("job.cancel", {"job": job})

    def __enter__(self) -> SetpointStream:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        leave(self.close, error)


class SetpointActions(ActionBase):
    """What makes the jaws follow a program's targets."""

    def stream(
        self,
        valid_s: float = 0.2,
        *,
        speed_mm_s: float | None = None,
        torque_nm: float | None = None,
    ) -> SetpointStream:
        """Begin a stream of targets; the jaws do not move before the first `set_target`.

        `valid_s`: 0.02 to 2 s, after which the jaws hold unless a new target came. `speed_mm_s`
        is how fast they follow at most (`motion_config.speed_mm_s` by default), `torque_nm`, 0.1
        to 3 N·m, what they press with at most on what stands in their way (1 by default).
        """
        limits = self._speed_limit() | given_numbers(speed_mm_s=speed_mm_s, torque_nm=torque_nm)
        self._end_frames()
        return SetpointStream(self._link, valid_s, limits)

    def _speed_limit(self) -> dict[str, float]:
        """Return the speed of the tunables, if it was set; nothing else of them is for streams."""
        config = self._motion_config.to_wire()
        return {name: config[name] for name in ("speed_mm_s",) if name in config}

    def send_mit_frame(
        self, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> bool:
        """Send a set-point for `position`, in rad, valid for 0.2 s; not a frame on the bus.

        The daemon's limits and gains stay in force: `velocity`, `kp` and `kd` are checked and
        then not used, |`torque`| above 1 N·m (at most 3) only lets the jaws press with up to so
        much, and they follow at `motion_config.speed_mm_s` at most.
        True when it is sent; a refusal is raised, perhaps by the next call. Raises
        `CommandError` with reason "unsupported" for `kp` 0, which asks for a torque, a speed or
        for nothing instead of a position: use `set_force`, `grasp`, `move_at_speed` or
        `zero_gravity`.
        """
        given = {"position": position, "velocity": velocity, "kp": kp, "kd": kd, "torque": torque}
        values = {name: number(name, value) for name, value in given.items()}
        if values["kp"] <= 0.0 or values["kd"] < 0.0:
            raise _no_position(values)
        if self._frames is None:
            self._frames = SetpointStream(self._link, _FRAME_VALID_S, self._speed_limit())
        press_nm = abs(values["torque"])
        self._frames.set_target(
            position_rad=values["position"],
            torque_nm=press_nm if press_nm > _CONTACT_TORQUE_NM else None,
        )
        return True


def _no_position(values: dict[str, float]) -> CommandError:
    if values["kp"] < 0.0 or values["kd"] < 0.0:
        text = f"kp is {values['kp']:g} and kd {values['kd']:g}, a gain cannot be negative"
        return CommandError(text, reason="invalid_params")
    if values["torque"] != 0.0:
        what, hint = "a torque", "set_force(force_n) or grasp(force_n=...)"
    elif values["velocity"] != 0.0:
        what, hint = "a speed", "move_at_speed(opening_mm, speed_mm_s)"
    else:
        what, hint = "loose jaws", "zero_gravity()"
    return CommandError(
        f"a frame with kp = 0 asks for {what}: the daemon takes only positions by frame",
        reason="unsupported",
        data={"hint": f"use {hint}"},
    )
