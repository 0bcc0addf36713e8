"""The frame of leader/follower teleoperation: 32 bytes that other stacks send and read, too.

Four big-endian float64: openness, position, force and the sender's time. Nothing is clamped here:
what is no number is no frame. Nor is one whose openness or position is subnormal: no measurement is
that small, but a double in the other byte order looks like that, and would close the jaws.
"""

import math
import struct
import sys
from dataclasses import dataclass

_FRAME = struct.Struct(">4d")
FRAME_BYTES = _FRAME.size


@dataclass(frozen=True, slots=True)
class TeleopFrame:
    """What a leader tells of itself.

    `openness` is 0 (closed) to 1 (open), `position_mm` its opening, `force_n` its force, squeezing
    positive. `timestamp_s` is of the sender's own clock: two machines share none, so that only
    differences of one sender mean something.
    """

    openness: float
    position_mm: float
    force_n: float
    timestamp_s: float


def encode_frame(frame: TeleopFrame) -> bytes:
    """Return the 32 bytes; raises `ValueError` for a value that is not finite."""
    values = (frame.openness, frame.position_mm, frame.force_n, frame.timestamp_s)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"a teleoperation frame needs finite values, not {values}")
    return _FRAME.pack(*values)


def decode_frame(payload: bytes) -> TeleopFrame | None:
    """Return the frame, or None for another length, a value that is not finite or a subnormal one.

    Only openness and position count as subnormal; a force may have been through a filter that
    decays, and is not followed.
    An openness beyond 0 to 1 is a frame all the same: who follows keeps to its own travel.
    """
    if len(payload) != FRAME_BYTES:
        return None
    values = _FRAME.unpack(payload)
    if not all(map(math.isfinite, values)) or any(map(_is_subnormal, values[:2])):
        return None
    return TeleopFrame(*values)


def _is_subnormal(value: float) -> bool:
    return 0.0 < abs(value) < sys.float_info.min
