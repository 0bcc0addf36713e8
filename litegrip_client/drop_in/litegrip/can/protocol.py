"""Frames of the motor's protocol, as bytes: pure functions, which open no bus.

`float_to_uint` truncates, as the SDK does; the daemon's own encoder rounds.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum

__all__ = [
    "BROADCAST_ID",
    "CMD_CLEAR_FAULT",
    "CMD_DISABLE",
    "CMD_ENABLE",
    "CMD_SET_ZERO",
    "DM_REG",
    "MOTOR_LIMITS",
    "ControlMode",
    "ControlModeCode",
    "MotorLimits",
    "ParsedParamResponse",
    "ParsedStatus",
    "float_to_uint",
    "get_motor_limits",
    "pack_command_frame",
    "pack_mit_frame",
    "pack_read_param_frame",
    "pack_refresh_frame",
    "pack_save_param_frame",
    "pack_write_param_frame",
    "uint_to_float",
    "unpack_param_response",
    "unpack_status_frame",
]

BROADCAST_ID = 0x7FF
CMD_ENABLE = 0xFC
CMD_DISABLE = 0xFD
CMD_CLEAR_FAULT = 0xFB
CMD_SET_ZERO = 0xFE

_FRAME_BYTES = 8
_READ, _WRITE, _SAVE, _REFRESH = 0x33, 0x55, 0xAA, 0xCC
_KP_MAX, _KD_MAX = 500.0, 5.0


class ControlMode(IntEnum):
    """Modes of the drive, by their offset to the CAN id of a command."""

    MIT_MODE = 0x000
    POS_VEL_MODE = 0x100
    VEL_MODE = 0x200
    POS_FORCE_MODE = 0x300


class ControlModeCode(IntEnum):
    """Modes of the drive, by the value of its register CTRL_MODE."""

    MIT = 1
    POS_VEL = 2
    VEL = 3
    POS_FORCE = 4


class DM_REG(IntEnum):  # noqa: N801 - the vendor's name
    """Registers of the drive."""

    UV_Value = 0
    KT_Value = 1
    OT_Value = 2
    OC_Value = 3
    ACC = 4
    DEC = 5
    MAX_SPD = 6
    MST_ID = 7
    ESC_ID = 8
    TIMEOUT = 9
    CTRL_MODE = 10
    Damp = 11
    Inertia = 12
    hw_ver = 13
    sw_ver = 14
    SN = 15
    NPP = 16
    Rs = 17
    LS = 18
    Flux = 19
    Gr = 20
    PMAX = 21
    VMAX = 22
    TMAX = 23
    I_BW = 24
    KP_ASR = 25
    KI_ASR = 26
    KP_APR = 27
    KI_APR = 28
    OV_Value = 29
    GREF = 30
    Deta = 31
    V_BW = 32
    IQ_c1 = 33
    VL_c1 = 34
    can_br = 35
    sub_ver = 36


_WHOLE_NUMBERS = frozenset((*range(7, 11), *range(13, 17), 35, 36))
"""Registers whose four bytes are an unsigned integer; the others are a float."""


@dataclass
class MotorLimits:
    """The ranges that a frame's fields stand for: rad, rad/s, N·m."""

    q_max: float
    dq_max: float
    tau_max: float


MOTOR_LIMITS = {
    1: MotorLimits(12.5, 30.0, 10.0),
    3: MotorLimits(12.5, 10.0, 28.0),
    6: MotorLimits(12.566, 20.0, 120.0),
}


def get_motor_limits(motor_type: int) -> MotorLimits:
    """Return a type's ranges; those of the DM4310 for a type that is not listed."""
    return MOTOR_LIMITS.get(int(motor_type), MOTOR_LIMITS[1])


@dataclass
class ParsedStatus:
    """A motor's report; `can_id` has the low four bits alone."""

    err: int
    can_id: int
    q: float
    dq: float
    tau: float
    t_mos: int
    t_coil: int


@dataclass
class ParsedParamResponse:
    """The answer to a register's reading, writing or saving."""

    can_id: int
    opcode: int
    rid: int
    value: float


def float_to_uint(value: float, value_min: float, value_max: float, bits: int) -> int:
    """Return a figure's place in its range, truncated; raises `ValueError` if it is not finite."""
    if not math.isfinite(value):
        raise ValueError(f"{value} is no finite number")
    clamped = min(max(value, value_min), value_max)
    return int((clamped - value_min) * ((1 << bits) - 1) / (value_max - value_min))


def uint_to_float(value: int, value_min: float, value_max: float, bits: int) -> float:
    """Return the figure at a place in its range."""
    return value * (value_max - value_min) / ((1 << bits) - 1) + value_min


def pack_mit_frame(
    q: float,
    dq: float,
    kp: float,
    kd: float,
    tau: float,
    q_max: float = 12.5,
    dq_max: float = 30.0,
    tau_max: float = 10.0,
) -> bytes:
    """Return the 8 bytes of a command: 16 bits of angle, and 12 each of the other four."""
    fields = (
        (float_to_uint(q, -q_max, q_max, 16), 16),
        (float_to_uint(dq, -dq_max, dq_max, 12), 12),
        (float_to_uint(kp, 0.0, _KP_MAX, 12), 12),
        (float_to_uint(kd, 0.0, _KD_MAX, 12), 12),
        (float_to_uint(tau, -tau_max, tau_max, 12), 12),
    )
    word = 0
    for value, bits in fields:
        word = word << bits | value
    return word.to_bytes(_FRAME_BYTES, "big")


def unpack_status_frame(
    data: bytes, q_max: float = 12.5, dq_max: float = 30.0, tau_max: float = 10.0
) -> ParsedStatus:
    """Return the figures of a motor's report; raises `ValueError` under 8 bytes."""
    if len(data) < _FRAME_BYTES:
        raise ValueError(f"{len(data)} bytes are no report, which has {_FRAME_BYTES}")
    return ParsedStatus(
        err=data[0] >> 4,
        can_id=data[0] & 0x0F,
        q=uint_to_float(data[1] << 8 | data[2], -q_max, q_max, 16),
        dq=uint_to_float(data[3] << 4 | data[4] >> 4, -dq_max, dq_max, 12),
        tau=uint_to_float((data[4] & 0x0F) << 8 | data[5], -tau_max, tau_max, 12),
        t_mos=data[6],
        t_coil=data[7],
    )


def pack_command_frame(cmd: int) -> bytes:
    """Return the 8 bytes of CMD_ENABLE and its like."""
    return bytes((*(0xFF,) * 7, cmd))


def pack_refresh_frame(can_id: int) -> bytes:
    """Return the 4 bytes that ask a motor for a report."""
    return bytes((can_id & 0xFF, can_id >> 8 & 0xFF, _REFRESH, 0))


def pack_read_param_frame(can_id: int, rid: int) -> bytes:
    """Return the 8 bytes that read a register."""
    return bytes((can_id & 0xFF, can_id >> 8 & 0xFF, _READ, rid, 0, 0, 0, 0))


def pack_write_param_frame(can_id: int, rid: int, value: float) -> bytes:
    """Return the 8 bytes that write a register, little-endian."""
    head = bytes((can_id & 0xFF, can_id >> 8 & 0xFF, _WRITE, rid))
    whole = rid in _WHOLE_NUMBERS
    return head + (struct.pack("<I", int(value)) if whole else struct.pack("<f", value))


def pack_save_param_frame(can_id: int) -> bytes:
    """Return the 8 bytes that have a motor keep its registers."""
    return bytes((can_id & 0xFF, can_id >> 8 & 0xFF, _SAVE, 1, 0, 0, 0, 0))


def unpack_param_response(data: bytes) -> ParsedParamResponse | None:
    """Return the answer about a register, None for bytes that are none."""
    if len(data) < _FRAME_BYTES or data[2] not in (_READ, _WRITE, _SAVE):
        return None
    rid = data[3]
    value = struct.unpack_from("<I" if rid in _WHOLE_NUMBERS else "<f", data, 4)[0]
    return ParsedParamResponse(data[0] | data[1] << 8, data[2], rid, float(value))
