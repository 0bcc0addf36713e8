"""Between this package and `litegrip_client`: errors, states and tunables in the SDK's terms."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import Any

from litegrip_client.core.discovery import in_any_shell
from litegrip_client.values import errors as ours
from litegrip_client.values.motion_config import DAEMON_FIELDS
from litegrip_client.values.motion_config import MotionConfig as OurMotionConfig
from litegrip_client.values.results import GripperState as OurState
from litegrip_client.values.results import MoveProgress as OurProgress
from litegrip_client.values.terms import Voice
from litegrip_client.values.voices import in_python, in_shell

from . import teleop, trajectory
from .actions import MotionConfig, MoveProgress
from .constants import UnitConversion
from .exceptions import (
    CANTimeoutError,
    CommandError,
    CommError,
    HardwareError,
    LiteGripError,
    NotInitializedError,
)
from .models import GripperConfig, GripperState


class SessionBusyError(teleop.TeleopBusyError, trajectory.TrajectoryBusyError):
    """Another session is in the way, whoever asks: teleoperation, a recording or a replay."""


_KINDS: tuple[tuple[type[ours.LiteGripError], type[LiteGripError]], ...] = (
    (ours.NotInitializedError, NotInitializedError),
    (ours.CANTimeoutError, CANTimeoutError),
    (ours.CommError, CommError),
    (ours.HardwareError, HardwareError),
    (ours.ConnectError, CommError),
    (ours.ProtocolError, CommError),
    (ours.TeleopBusyError, SessionBusyError),
    (ours.TrajectoryBusyError, SessionBusyError),
    (ours.TeleopNotReady, teleop.TeleopNotReady),
    (ours.TeleopNotActiveError, teleop.TeleopNotActiveError),
    (ours.TeleopError, teleop.TeleopError),
    (ours.TrajectoryNotActiveError, trajectory.TrajectoryNotActiveError),
    (ours.TrajectoryEmptyError, trajectory.TrajectoryEmptyError),
    (ours.TrajectoryRecordingError, trajectory.TrajectoryRecordingError),
    (ours.TrajectoryFormatError, trajectory.TrajectoryFormatError),
    (ours.TrajectoryError, trajectory.TrajectoryError),
)
"""The first that fits counts; what is none of these, a lease or a stop too, is a `CommandError`."""


_SESSIONS = ("teleop", "record", "play")


def translated(error: ours.LiteGripError) -> LiteGripError:
    """Return the SDK's exception for one of the client's, which becomes its context."""
    if error.reason == "not_connected":
        return NotInitializedError("not connected: call connect() first")
    if error.reason == "busy" and error.data.get("kind") in _SESSIONS:
        return SessionBusyError(str(error))
    kind = next((theirs for kind, theirs in _KINDS if isinstance(error, kind)), CommandError)
    return kind(str(error), error.error_code)


@contextmanager
def in_their_terms() -> Iterator[None]:
    """Raise what the client raises as the SDK's exception."""
    try:
        yield
    except ours.LiteGripError as error:
        raise translated(error) from None


def voice_of(kind: type, channel: str) -> Voice:
    """Return what names what the daemon's messages name: calls of `kind`, else of its `daemon`.

    Commands for a shell are those for the gripper of `channel`.
    """
    here = in_any_shell(channel)

    def own(call: re.Match[str]) -> str:
        return call[0] if hasattr(kind, call[1]) else f"gripper.daemon.{call[1]}"

    def voice(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        is_of_shell = (method, parameter) == ("trajectory.record_stop", "allow_partial")
        named = (in_shell if is_of_shell else in_python)(method, parameter, asked)
        return named and here(re.sub(r"\bgripper\.(\w+)", own, named))

    return voice


def opening_mm(angle_rad: float, config: GripperConfig) -> float:
    """Return the opening of an angle, mm, with the program's own limits and scale."""
    return (config.pos_closed_rad - angle_rad) * config.close_sign * config.rad_to_mm


def state_of(state: OurState, config: GripperConfig) -> GripperState:
    """Return a state with the program's own limits and scale; `config` converts it."""
    position_rad = state.position_rad or 0.0
    torque_nm = state.torque_nm or 0.0
    age_s = math.inf if state.age_s is None else state.age_s
    return GripperState(
        position_rad,
        state.velocity_rad_s or 0.0,
        torque_nm,
        int(state.driver_temperature_c or 0),
        int(state.coil_temperature_c or 0),
        state.error_code or 0,
        time.time() - (0.0 if math.isinf(age_s) else age_s),
        opening_mm(position_rad, config),
        config.close_sign * torque_nm * UnitConversion.NM_TO_N,
        age_s,
    )


_PLAIN = MotionConfig()
_OWN = ("frame_interval", "hold_interval", "hold_kp", "hold_kd")
"""What the daemon has, too, and is not asked for here: slices of a hold are counted here."""
_SENT = tuple(
    one.name for one in fields(MotionConfig) if one.name in DAEMON_FIELDS and one.name not in _OWN
)


def motion_config_of(config: MotionConfig) -> OurMotionConfig:
    """Return the tunables that differ from the SDK's defaults; the others are the daemon's."""
    values: dict[str, Any] = {
        name: getattr(config, name)
        for name in _SENT
        if getattr(config, name) != getattr(_PLAIN, name)
    }
    if config.force_ramp_n_s != _PLAIN.force_ramp_n_s:
        values["force_ramp_n_s"] = config.force_ramp_n_s
    with in_their_terms():
        return OurMotionConfig(**values)


_REPORT_S = 0.05
"""The daemon reports a motion 20 times a second."""


class Samples:
    """Passes the daemon's reports of a way on as the SDK's samples, in the caller's thread.

    A sample is due each `sample_interval`, which the daemon's reports bound below: 0.05 s. `i`
    counts the frames of its time, 10 to 0.05 s.
    """

    def __init__(
        self, progress: Callable[[MoveProgress], None] | None, config: MotionConfig
    ) -> None:
        self._progress = progress
        self._share = max(1, round(config.sample_interval / _REPORT_S))
        self._frames = round(_REPORT_S / _PLAIN.frame_interval)
        self._settling = round(config.settle_s / _PLAIN.frame_interval)
        self._window = config.stall_cycles
        self._seen: list[float] = []
        self._reports = -1  # the first report comes with the first frame, and is no sample
        self._total = self._last = 0

    def take(self, one: OurProgress) -> None:
        """Take a report of the daemon's."""
        self._reports += 1
        progress = self._progress
        if progress is None or self._reports <= 0 or self._reports % self._share:
            return
        i = self._reports * self._frames
        self._total = max(self._total, one.total_steps + self._settling, i)
        self._pass_on(progress, i, one.cmd_rad, one.pos_rad, one.torque_nm, one.temperature_coil)

    def end(self, steps: int, command_rad: float, state: OurState) -> None:
        """Pass on the last frame, unless a sample was due with it."""
        progress = self._progress
        if progress is not None and steps != self._last:
            self._total = max(self._total, steps)
            at_rad, torque_nm = state.position_rad or 0.0, state.torque_nm or 0.0
            coil_c = state.coil_temperature_c
            self._pass_on(progress, steps, command_rad, at_rad, torque_nm, coil_c)

    def _pass_on(
        self,
        progress: Callable[[MoveProgress], None],
        i: int,
        command_rad: float,
        at_rad: float,
        torque_nm: float,
        coil_c: float | None,
    ) -> None:
        self._last = i
        before_rad = self._seen[-1] if self._seen else at_rad
        self._seen.append(at_rad)
        del self._seen[: -self._window - 1]
        is_full = len(self._seen) == self._window + 1
        progress(
            MoveProgress(
                "move",
                i,
                self._total,
                command_rad,
                at_rad,
                at_rad - before_rad,
                at_rad - self._seen[0] if is_full else None,
                torque_nm,
                int(coil_c or 0),
            )
        )


def finite(name: str, value: Any) -> float:
    """Return a figure; raises `CommandError` unless it is a finite number."""
    try:
        figure = float(value)
    except (TypeError, ValueError, OverflowError):
        figure = math.nan
    if isinstance(value, str | bytes | bool) or not math.isfinite(figure):
        raise CommandError(f"{name} is {value!r:.60}, it must be a finite number")
    return figure


_KP_RANGE, _KD_RANGE, _LEAST_DAMPING = (5.0, 500.0), (0.1, 5.0), 0.002
"""The daemon's ranges of gains; kd is at least kp · 0.002 s."""


def gains_in_range(kp: float, kd: float) -> tuple[float, float]:
    """Return gains inside the daemon's ranges; raises `CommandError` for what is not finite."""
    stiff = min(max(finite("kp", kp), _KP_RANGE[0]), _KP_RANGE[1])
    least = max(_KD_RANGE[0], stiff * _LEAST_DAMPING)
    return stiff, min(max(finite("kd", kd), least), _KD_RANGE[1])
