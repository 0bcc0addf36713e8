"""The frame by which a follower tells its leader's hand how hard it presses: 40 bytes of our own.

It has a key of its own, and a length and a mark that no frame of a leader has: neither is ever
taken for the other.
"""

import math
import struct
from dataclasses import dataclass

MAGIC = b"LGFORCE1"
_FRAME = struct.Struct(">8sQ3d")
FORCE_FRAME_BYTES = _FRAME.size
LARGEST_SENDER = 2**64 - 1


@dataclass(frozen=True, slots=True)
class ForceFrame:
    """What a follower tells of itself.

    `sender` is a number that it alone has, 0 to 2^64 - 1. `force_n` is the force at its jaws,
    squeezing positive. `timestamp_s` is of its own clock; `echo_s` is the timestamp of the leader's
    frame that it followed last, of the leader's clock: by it alone the leader knows how old the
    answer to its position is.
    """

    sender: int
    force_n: float
    timestamp_s: float
    echo_s: float


def encode_force(frame: ForceFrame) -> bytes:
    """Return the 40 bytes; raises `ValueError` for a value that is not finite or no sender."""
    values = (frame.force_n, frame.timestamp_s, frame.echo_s)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"a force frame needs finite values, not {values}")
    if not 0 <= frame.sender <= LARGEST_SENDER:
        raise ValueError(f"a sender is 0 to 2^64 - 1, not {frame.sender}")
    return _FRAME.pack(MAGIC, frame.sender, *values)


def decode_force(payload: bytes) -> ForceFrame | None:
    """Return the frame, or None for another length or mark, or a value that is not finite."""
    if len(payload) != FORCE_FRAME_BYTES:
        return None
    magic, sender, *values = _FRAME.unpack(payload)
    if magic != MAGIC or not all(map(math.isfinite, values)):
        return None
    return ForceFrame(sender, *values)
