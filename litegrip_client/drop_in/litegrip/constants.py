"""Figures and enumerations of the SDK: of the motor, its drive and the gripper that ships."""

from __future__ import annotations

from .can.motor import MotorType
from .can.protocol import ControlMode

__all__ = [
    "ERROR_DESCRIPTIONS",
    "Control_Mode",
    "DM_Motor_Type",
    "DefaultParams",
    "ErrorCode",
    "GripperGeometry",
    "GripperParams",
    "MotorType",
    "UnitConversion",
    "describe_error",
]

DM_Motor_Type = MotorType
Control_Mode = ControlMode


class GripperParams:
    """What a gripper has that nobody configured. The angles are placeholders until calibrated."""

    CAN_ID = 0x08
    MST_ID = 0x18
    MOTOR_TYPE = MotorType.DM4310
    CONTROL_MODE = ControlMode.MIT_MODE
    POS_CLOSED_RAD = 1.14
    POS_OPEN_RAD = 0.0
    Q_MAX = 12.5
    DQ_MAX = 30.0
    TAU_MAX = 10.0
    DEFAULT_KP = 100.0
    DEFAULT_KD = 2.0
    FAULT_CLEAR_RETRIES = 5
    FAULT_CLEAR_DELAY_S = 0.02


class GripperGeometry:
    """How far the jaws open, in mm, as a caliper measures it."""

    JAW_TRAVEL_MM = 85.0
    STOP_INSET_MM = 1.0
    """By so much the recorded extremes span more than the jaws travel."""
    SPAN_MM = JAW_TRAVEL_MM + STOP_INSET_MM


class UnitConversion:
    """Millimetres and radians, newtons and newton metres: nominal figures."""

    RAD_TO_MM = GripperGeometry.SPAN_MM / 1.14
    MM_TO_RAD = 1.0 / RAD_TO_MM
    NM_TO_N = 10.0
    N_TO_NM = 0.1


class DefaultParams:
    """The bus, as it is without any argument."""

    CAN_CHANNEL = "can0"
    CAN_BITRATE = 1_000_000
    CANFD_MODE = False
    TIMEOUT_S = 0.1
    INIT_TIMEOUT_S = 2.0


class ErrorCode:
    """The motor's status, `error_code` of a state."""

    DISABLED = 0
    ENABLED = 1
    OV_FAULT = 8
    UV_FAULT = 9
    OC_FAULT = 10
    MOS_OT = 11
    COIL_OT = 12
    COMM_LOSS = 13
    OVERLOAD = 14


ERROR_DESCRIPTIONS = {
    ErrorCode.DISABLED: "disabled",
    ErrorCode.ENABLED: "enabled",
    ErrorCode.OV_FAULT: "over-voltage: the supply is above its range",
    ErrorCode.UV_FAULT: "under-voltage: no 24 V, or too little",
    ErrorCode.OC_FAULT: "over-current",
    ErrorCode.MOS_OT: "the driver is too hot",
    ErrorCode.COIL_OT: "the coil is too hot",
    ErrorCode.COMM_LOSS: "no command came for too long",
    ErrorCode.OVERLOAD: "overload",
}


def describe_error(code: int) -> str:
    """Return a status in words; an unknown one by its number."""
    return ERROR_DESCRIPTIONS.get(code, f"unknown status 0x{code:X}")
