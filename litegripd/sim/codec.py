"""How the motor's firmware reads and writes its frames.

Kept apart from the daemon's codec on purpose: two implementations that agree are worth more than
one that agrees with itself. The firmware truncates where a careful driver rounds.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

KP_MAX_NM_RAD = 500.0
KD_MAX_NM_S_RAD = 5.0


@dataclass(frozen=True, slots=True)
class Ranges:
    """The ranges of position (rad), velocity (rad/s) and torque (N·m): registers 21, 22, 23."""

    position_rad: float = 12.5
    velocity_rad_s: float = 30.0
    torque_nm: float = 10.0


class MitCommand(NamedTuple):
    """A command frame, in units (motor's manual, MIT mode)."""

    position_rad: float
    velocity_rad_s: float
    kp_nm_rad: float
    kd_nm_s_rad: float
    torque_nm: float


class SetPoint(NamedTuple):
    """What a command frame of mode 2, 3 or 4 asks for, in units; in mode 3 there is no position.

    With a position the speed is a bound. `current_share` is the share of the largest current that
    may be used, 0 to 1.
    """

    position_rad: float | None
    velocity_rad_s: float
    current_share: float = 1.0


def to_code(value: float, low: float, high: float, bits: int) -> int:
    """Return the code of a value in [low, high], truncated; beyond it the nearest end's code."""
    most = (1 << bits) - 1
    return min(max(int((value - low) * most / (high - low)), 0), most)


def from_code(code: int, low: float, high: float, bits: int) -> float:
    """Return the value that a code of `bits` bits stands for."""
    return code * (high - low) / ((1 << bits) - 1) + low


def decode_command(data: bytes, ranges: Ranges) -> MitCommand:
    """Read a command frame of 8 bytes; every such frame is a command."""
    word = int.from_bytes(data, "big")
    q, dq, tau = ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm
    return MitCommand(
        from_code(word >> 48, -q, q, 16),
        from_code(word >> 36 & 0xFFF, -dq, dq, 12),
        (word >> 24 & 0xFFF) * KP_MAX_NM_RAD / 0xFFF,
        (word >> 12 & 0xFFF) * KD_MAX_NM_S_RAD / 0xFFF,
        from_code(word & 0xFFF, -tau, tau, 12),
    )


def decode_set_point(data: bytes, mode: int) -> SetPoint | None:
    """Read a command frame of control mode 2, 3 or 4, or return None for one that is none.

    Little-endian: position and bound of the speed as float32 (2), the speed as float32 (3), or the
    position as float32, then the bound in 0.01 rad/s and the share of the current in 1/10000, both
    uint16 (4). A value that is not finite is no command; what a real motor does then is not known.
    """
    if len(data) < (4 if mode == 3 else 8):
        return None
    if mode == 2:
        set_point = SetPoint(*struct.unpack("<ff", data))
    elif mode == 3:
        set_point = SetPoint(None, *struct.unpack("<f", data[:4]))
    else:
        position_rad, speed, current = struct.unpack("<fHH", data)
        set_point = SetPoint(position_rad, speed / 100.0, min(current / 10000.0, 1.0))
    return set_point if all(math.isfinite(value or 0.0) for value in set_point) else None


def position_code(position_rad: float, range_rad: float) -> int:
    """Return the 16-bit code of a reported position: beyond the range it wraps (firmware)."""
    return int((position_rad + range_rad) * 0xFFFF / (2.0 * range_rad) // 1.0) & 0xFFFF


def encode_feedback(
    *, motor_id: int, status: int, codes: tuple[int, int, int], driver_c: float, coil_c: float
) -> bytes:
    """Write a feedback frame of 8 bytes from the codes of position, velocity and torque."""
    position, velocity, torque = codes
    return bytes(
        (
            status << 4 | motor_id & 0xF,
            position >> 8,
            position & 0xFF,
            velocity >> 4,
            (velocity & 0xF) << 4 | torque >> 8,
            torque & 0xFF,
            min(max(int(driver_c), 0), 255),
            min(max(int(coil_c), 0), 255),
        )
    )
