"""Constants and frames of teleoperation, by the SDK's names (see docs/teleoperation.md)."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from litegrip_client.errors import ParameterError

DEFAULT_GRIP_ID = "gripA"
DEFAULT_GRIP_PORT = 17448
DEFAULT_DQ_MAX = 10.0
"""Most of the leader's velocity that a follower feeds forward, rad/s."""
DEFAULT_TORQUE_LIMIT_NM = 0.0
"""The torque guard of a follower: off."""
MAX_FRAME_GAP_S = 0.05
"""After a longer gap a follower feeds no velocity forward."""
TORQUE_TRIP_CYCLES = 3
"""Cycles of the SDK's 50 Hz loop; here 60 ms at every rate."""
TORQUE_REARM_OPENNESS = 0.05

_FRAME = struct.Struct(">4d")
FRAME_SIZE = _FRAME.size


class TeleopFrame(NamedTuple):
    """One frame: the leader's openness (0 closed to 1 open), and what its jaws measure."""

    openness: float
    position_mm: float
    force_n: float
    timestamp: float


def encode_frame(
    openness: float, position_mm: float = 0.0, force_n: float = 0.0, timestamp: float = 0.0
) -> bytes:
    """Return the 32 bytes of a frame. Raises `ParameterError` for what a receiver drops."""
    return _FRAME.pack(*_checked(TeleopFrame(openness, position_mm, force_n, timestamp)))


def decode_frame(payload: bytes) -> TeleopFrame:
    """Return a frame's figures. Raises `ParameterError` for what is no frame."""
    if len(payload) != FRAME_SIZE:
        text = f"{len(payload)} bytes are no frame, which has {FRAME_SIZE}"
        raise ParameterError(text, reason="invalid_params")
    return _checked(TeleopFrame(*_FRAME.unpack(payload)))


def _checked(frame: TeleopFrame) -> TeleopFrame:
    for name, value in zip(frame._fields, frame, strict=True):
        if not math.isfinite(value):
            text = f"{name} of a frame is {value}, it must be a finite number"
            raise ParameterError(text, reason="invalid_params", data={"parameter": name})
    return frame


def teleop_topic(grip_id: str = DEFAULT_GRIP_ID) -> str:
    """Return the key of the frames on zenoh."""
    return f"litearm/v4/{grip_id}/gripper_teleop"
