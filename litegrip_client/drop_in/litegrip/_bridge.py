"""Between this package and `litegrip_client`: its errors, states and tunables in the SDK's terms."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import Any, NoReturn

from litegrip_client.values import errors as ours
from litegrip_client.values.motion_config import DAEMON_FIELDS
from litegrip_client.values.motion_config import MotionConfig as OurMotionConfig
from litegrip_client.values.results import GripperState as OurState
from litegrip_client.values.results import MoveProgress as OurProgress

from . import teleop, trajectory
from .actions import MotionConfig, MoveProgress
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


def translated(error: ours.LiteGripError) -> LiteGripError:
    """Return the SDK's exception for one of the client's, which becomes its cause."""
    if error.reason == "not_connected":
        return NotInitializedError("not connected: call connect() first")
    kind = next((theirs for kind, theirs in _KINDS if isinstance(error, kind)), CommandError)
    return kind(str(error), error.error_code)


@contextmanager
def in_their_terms() -> Iterator[None]:
    """Raise what the client raises as the SDK's exception."""
    try:
        yield
    except ours.LiteGripError as error:
        raise translated(error) from error


def state_of(state: OurState, config: GripperConfig) -> GripperState:
    """Return a state with the program's own limits and scale; `config` converts it."""
    position_rad = state.position_rad or 0.0
    torque_nm = state.torque_nm or 0.0
    age_s = math.inf if state.age_s is None else state.age_s
    sign = config.close_sign
    return GripperState(
        position_rad,
        state.velocity_rad_s or 0.0,
        torque_nm,
        int(state.driver_temperature_c or 0),
        int(state.coil_temperature_c or 0),
        state.error_code or 0,
        time.time() - (0.0 if math.isinf(age_s) else age_s),
        (config.pos_closed_rad - position_rad) * sign * config.rad_to_mm,
        sign * torque_nm * config.nm_to_n,
        age_s,
    )


_PLAIN = MotionConfig()
_SENT = tuple(
    one.name
    for one in fields(MotionConfig)
    if one.name in DAEMON_FIELDS and one.name not in ("frame_interval", "hold_kp", "hold_kd")
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
    return OurMotionConfig(**values)


def reporter(
    progress: Callable[[MoveProgress], None] | None, window: int
) -> Callable[[OurProgress], None] | None:
    """Return what takes the client's reports of a way and passes them on as the SDK's samples."""
    if progress is None:
        return None
    seen: list[float] = []

    def report(one: OurProgress) -> None:
        before = seen[-1] if seen else one.pos_rad
        seen.append(one.pos_rad)
        del seen[: -window - 1]
        full = len(seen) == window + 1
        progress(
            MoveProgress(
                "move",
                one.i,
                one.total_steps,
                one.cmd_rad,
                one.pos_rad,
                one.pos_rad - before,
                one.pos_rad - seen[0] if full else None,
                one.torque_nm,
                int(one.temperature_coil or 0),
            )
        )

    return report


def finite(name: str, value: Any) -> float:
    """Return a figure; raises `CommandError` unless it is a finite number."""
    try:
        figure = float(value)
    except (TypeError, ValueError, OverflowError):
        figure = math.nan
    if isinstance(value, str | bytes) or not math.isfinite(figure):
        _refuse(f"{name} is {value!r:.60}, it must be a finite number")
    return figure


def _refuse(text: str) -> NoReturn:
    raise CommandError(text)
