"""The motor's protocol. Frames are made and read here; the bus itself is the daemon's."""

from .controller import MotorController
from .motor import MotorParams, MotorState, MotorType
from .protocol import (
    float_to_uint,
    pack_command_frame,
    pack_mit_frame,
    pack_read_param_frame,
    pack_refresh_frame,
    pack_save_param_frame,
    pack_write_param_frame,
    uint_to_float,
    unpack_param_response,
    unpack_status_frame,
)
from .transport import CanFrame, CanMode, CanTransport

__all__ = [
    "CanFrame",
    "CanMode",
    "CanTransport",
    "MotorController",
    "MotorParams",
    "MotorState",
    "MotorType",
    "float_to_uint",
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
