"""The MIT-mode frames of a Damiao motor: bytes in, values out.

Command and feedback pack each field as a linear map of its range onto all codes of its width,
big-endian. The encoder rounds to the nearest code: truncating, as most drivers do, biases every
torque by half a code.
"""

import math

from litegripd.model.motor import Feedback, MitCommand, Ranges

KP_MAX_NM_RAD = 500.0
KD_MAX_NM_S_RAD = 5.0
FRAME_BYTES = 8

_SPECIAL = b"\xff" * 7
ENABLE = _SPECIAL + b"\xfc"
DISABLE = _SPECIAL + b"\xfd"
SET_ZERO = _SPECIAL + b"\xfe"
CLEAR_FAULT = _SPECIAL + b"\xfb"

_CODES_16 = (1 << 16) - 1
_CODES_12 = (1 << 12) - 1


def encode_command(command: MitCommand, ranges: Ranges) -> bytes:
    """Pack a command into its 8 bytes.

    Raises `ValueError` for a field that is not finite or out of its range. A clamped NaN would
    become an end of the range: a real command that nobody asked for.
    """
    position = _to_code("position_rad", command.position_rad, ranges.position_rad, _CODES_16)
    velocity = _to_code("velocity_rad_s", command.velocity_rad_s, ranges.velocity_rad_s, _CODES_12)
    torque = _to_code("torque_nm", command.torque_nm, ranges.torque_nm, _CODES_12)
    kp = _to_gain_code("kp_nm_rad", command.kp_nm_rad, KP_MAX_NM_RAD)
    kd = _to_gain_code("kd_nm_s_rad", command.kd_nm_s_rad, KD_MAX_NM_S_RAD)
    packed = position << 48 | velocity << 36 | kp << 24 | kd << 12 | torque
    return packed.to_bytes(FRAME_BYTES, "big")


def encode_zero_gains(position_rad: float, ranges: Ranges) -> bytes:
    """Pack the command that energises nothing, neither now nor when the motor is enabled later.

    Without gains the position has no effect; one beyond the range becomes the end of the range.
    """
    position_rad = min(max(position_rad, -ranges.position_rad), ranges.position_rad)
    return encode_command(MitCommand(position_rad, 0.0, 0.0, 0.0, 0.0), ranges)


def decode_command(data: bytes, ranges: Ranges) -> MitCommand:
    """Unpack a command frame; raises `ValueError` unless it has 8 bytes."""
    packed = _packed(data)
    return MitCommand(
        position_rad=_from_code(packed >> 48 & _CODES_16, ranges.position_rad, _CODES_16),
        velocity_rad_s=_from_code(packed >> 36 & _CODES_12, ranges.velocity_rad_s, _CODES_12),
        kp_nm_rad=(packed >> 24 & _CODES_12) * KP_MAX_NM_RAD / _CODES_12,
        kd_nm_s_rad=(packed >> 12 & _CODES_12) * KD_MAX_NM_S_RAD / _CODES_12,
        torque_nm=_from_code(packed & _CODES_12, ranges.torque_nm, _CODES_12),
    )


def decode_feedback(data: bytes, ranges: Ranges, at_s: float) -> Feedback:
    """Unpack a feedback frame; raises `ValueError` unless it has 8 bytes."""
    packed = _packed(data)
    return Feedback(
        status=packed >> 60,
        position_rad=_from_code(packed >> 40 & _CODES_16, ranges.position_rad, _CODES_16),
        velocity_rad_s=_from_code(packed >> 28 & _CODES_12, ranges.velocity_rad_s, _CODES_12),
        torque_nm=_from_code(packed >> 16 & _CODES_12, ranges.torque_nm, _CODES_12),
        driver_temperature_c=packed >> 8 & 0xFF,
        coil_temperature_c=packed & 0xFF,
        at_s=at_s,
    )


def is_from_motor(data: bytes, can_id: int) -> bool:
    """Return True if a frame on the master id can be feedback of the motor `can_id`."""
    return len(data) == FRAME_BYTES and data[0] & 0xF == can_id & 0xF


def _packed(data: bytes) -> int:
    if len(data) != FRAME_BYTES:
        raise ValueError(f"a frame has {FRAME_BYTES} bytes, not {len(data)}")
    return int.from_bytes(data, "big")


def _to_code(name: str, value: float, limit: float, codes: int) -> int:
    if not math.isfinite(value) or abs(value) > limit:
        raise ValueError(f"{name} is {value}, it must be within ±{limit:g}")
    return round((value + limit) * codes / (2.0 * limit))


def _to_gain_code(name: str, value: float, limit: float) -> int:
    if not math.isfinite(value) or not 0.0 <= value <= limit:
        raise ValueError(f"{name} is {value}, it must be 0 to {limit:g}")
    return round(value * _CODES_12 / limit)


def _from_code(code: int, limit: float, codes: int) -> float:
    return limit * (2.0 * code / codes - 1.0)  # rounding never leads beyond the limit
