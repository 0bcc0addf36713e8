"""Constants, enumerations and frames of the SDK, by its names."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import NamedTuple

from litegrip_client.values.errors import ParameterError


class GripperStatus(Enum):
    """What the gripper does, `mode` of a state."""

    OFFLINE = "offline"
    DISABLED = "disabled"
    ENABLING = "enabling"
    HOLDING = "holding"
    MOVING = "moving"
    RELAXED = "relaxed"
    DISABLING = "disabling"
    FAULT = "fault"


class DM_Motor_Type(IntEnum):  # noqa: N801 - the vendor's name
    """Motors of the maker's family, by the numbers of its own drivers.

    The daemon drives some of them; its `[motor] type` says which it has.
    """

    DM3507 = 0
    DM4310 = 1
    DM4310_48V = 2
    DM4340 = 3
    DM4340_48V = 4
    DM6006 = 5
    DM6248P = 6
    DM8006 = 7
    DM8009 = 8
    DM10010L = 9
    DM10010 = 10
    DMH3510 = 11
    DMH6215 = 12
    DMS3519 = 13
    DMG6220 = 14


class Control_Mode(IntEnum):  # noqa: N801 - the vendor's name
    """Values of the motor's register CTRL_MODE; the daemon uses MIT."""

    MIT = 1
    POS_VEL = 2
    VEL = 3
    FORCE_POS = 4


GripperMode = Control_Mode


class DefaultParams:
    """Figures of a gripper that nobody configured; `config` of a gripper has its own ones."""

    CAN_CHANNEL = "can0"
    CAN_ID = 0x08
    MST_ID = 0x18
    KP = 100.0
    KD = 2.0
    FORCE_N = 20.0
    SPEED_MM_S = 50.0
    MAX_STROKE_MM = 85.0
    RAD_TO_MM = 86.0 / 1.14
    NM_TO_N = 10.0


GripperParams = DefaultParams


@dataclass(frozen=True, slots=True)
class GripperInfo:
    """The gripper and its motor, as `get_info` found them; None stands for what is unknown."""

    channel: str
    can_id: int
    mst_id: int | None
    motor_type: str
    mount: str | None
    calibrated: bool
    daemon_version: str
    hardware_version: int | None
    software_version: int | None
    serial_number: int | None


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
