"""Constants, enumerations and small values of the SDK, by its names."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum


class ErrorCode(IntEnum):
    """The motor's status nibble, `error_code` of a state (maker's table)."""

    DISABLED = 0x0
    ENABLED = 0x1
    OVER_VOLTAGE = 0x8
    UNDER_VOLTAGE = 0x9
    OVER_CURRENT = 0xA
    DRIVER_HOT = 0xB
    COIL_HOT = 0xC
    COMMUNICATION_LOST = 0xD
    OVERLOAD = 0xE


STATUS_CODES = {code.name.lower(): int(code) for code in ErrorCode}
"""A status as the daemon names it: its nibble."""


def describe_error(code: int) -> str:
    """Return a status nibble in words; an unknown one by its number."""
    try:
        return ErrorCode(code).name.replace("_", " ").lower()
    except ValueError:
        return f"unknown status {code}"


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
    """Motors of the maker's family, by the numbers of its own drivers."""

    DM4310 = 0
    DM4310_48V = 1
    DM4340 = 2
    DM4340_48V = 3
    DM6006 = 4
    DM8006 = 5
    DM8009 = 6
    DM10010L = 7
    DM10010 = 8
    DMH3510 = 9
    DMH6215 = 10
    DMG6220 = 11


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
    MAX_STROKE_MM = 120.0
    RAD_TO_MM = 74.8
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
