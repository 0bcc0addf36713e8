"""Values of the SDK: plain objects, which a program may make, assign, copy and compare."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag

from .constants import GripperParams, UnitConversion

__all__ = [
    "STALE_AFTER_S",
    "CalibrationData",
    "GripperConfig",
    "GripperInfo",
    "GripperMode",
    "GripperState",
    "GripperStatus",
]

STALE_AFTER_S = 0.5
"""Older figures are stale."""

_STILL_RAD_S = 0.01


class GripperMode(IntEnum):
    """What a command asks of the motor; MIT is the one in use."""

    MIT = 0
    POSITION = 1
    VELOCITY = 2
    FORCE = 3


class GripperStatus(IntFlag):
    """What holds of the gripper."""

    NONE = 0
    ENABLED = 1
    MOVING = 2
    AT_TARGET = 4
    GRASPED = 8
    ERROR = 16


@dataclass
class GripperState:
    """What the motor measured: rad, rad/s, N·m, °C; `position_mm` is the opening, 0 closed.

    `force_n` is positive where the motor closes. `timestamp` is in Unix seconds, `data_age_s` the
    age of the figures: infinite before the motor's first answer.
    """

    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    torque_nm: float = 0.0
    temperature_mos: int = 0
    temperature_coil: int = 0
    error_code: int = 0
    timestamp: float = field(default_factory=time.time)
    position_mm: float = 0.0
    force_n: float = 0.0
    data_age_s: float = math.inf

    @property
    def is_enabled(self) -> bool:
        """True if the motor says that it is enabled."""
        return self.error_code == 1

    @property
    def is_error(self) -> bool:
        """True if the motor reports a fault."""
        return self.error_code not in (0, 1)

    @property
    def is_moving(self) -> bool:
        """True above 0.01 rad/s."""
        return abs(self.velocity_rad_s) > _STILL_RAD_S

    @property
    def aperture_mm(self) -> float:
        """The whole opening in mm, as `position_mm`."""
        return self.position_mm

    @property
    def has_data(self) -> bool:
        """True if the motor has answered."""
        return self.data_age_s != math.inf

    @property
    def is_stale(self) -> bool:
        """True if the figures are older than 0.5 s."""
        return self.data_age_s > STALE_AFTER_S


@dataclass
class GripperConfig:
    """Ids, gains and limits of a program's gripper; what is assigned counts from the next call.

    Gains are N·m/rad and N·m·s/rad; `max_stroke_mm` is how far the jaws open, as a caliper measures
    it: a calibration takes its scale of it. `work_stroke_mm` is the opening to which `open` goes, 0
    for the open stop.
    """

    can_channel: str = "can0"
    can_id: int = GripperParams.CAN_ID
    mst_id: int | None = None
    canfd_mode: bool = False
    kp: float = GripperParams.DEFAULT_KP
    kd: float = GripperParams.DEFAULT_KD
    pos_closed_rad: float = GripperParams.POS_CLOSED_RAD
    pos_open_rad: float = GripperParams.POS_OPEN_RAD
    calibrated: bool = False
    max_stroke_mm: float = 85.0
    work_stroke_mm: float = 0.0
    rad_to_mm: float = UnitConversion.RAD_TO_MM
    nm_to_n: float = UnitConversion.NM_TO_N
    grasp_torque_threshold: float = 0.5

    @property
    def close_sign(self) -> float:
        """1.0 if closing runs towards larger angles, else -1.0."""
        return 1.0 if self.pos_closed_rad >= self.pos_open_rad else -1.0

    @property
    def mount(self) -> str | None:
        """Which way the motor is mounted, "normal" or "reverse"; None while not calibrated."""
        if not self.calibrated:
            return None
        return "normal" if self.close_sign > 0.0 else "reverse"


@dataclass
class GripperInfo:
    """The gripper and its motor."""

    model: str = "LiteGrip"
    motor_type: str = "DM4310"
    can_id: int = GripperParams.CAN_ID
    mst_id: int = GripperParams.MST_ID
    firmware_version: str = ""
    serial_number: str = ""


@dataclass
class CalibrationData:
    """What a calibration found: the closed and the open limit in rad, and the scale.

    `calibration_time` is local time, as "2026-10-31 14:05:09".
    """

    zero_position: float = GripperParams.POS_CLOSED_RAD
    max_position: float = GripperParams.POS_OPEN_RAD
    travel_range: float = abs(GripperParams.POS_CLOSED_RAD - GripperParams.POS_OPEN_RAD)
    rad_to_mm: float = UnitConversion.RAD_TO_MM
    motor_type: str = "DM4310"
    can_id: int = GripperParams.CAN_ID
    mst_id: int = GripperParams.MST_ID
    calibration_time: str = ""

    @property
    def travel_mm(self) -> float:
        """The travel in mm."""
        return self.travel_range * self.rad_to_mm
