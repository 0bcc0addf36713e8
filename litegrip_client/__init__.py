"""Drive a LiteGrip gripper through its daemon, with the vendor SDK's names.

    from litegrip_client import LiteGrip

    with LiteGrip("can0") as gripper:
        gripper.enable()
        gripper.close()

`litegrip_client.aio` offers the same on asyncio. It is imported on first use.

The client uses the standard library only and imports nothing of the daemon. `typing` and
`dataclasses` take as long to import as everything else together. So the modules import `typing`
only for the type checker (which knows `TYPE_CHECKING`, whatever its origin), and `dataclasses`
when the first object is made.
"""

from __future__ import annotations

import sys

if sys.version_info < (3, 10):  # noqa: UP036 - a copy beside a script was installed by no pip
    raise ImportError(
        "litegrip_client needs Python 3.10 or newer, this is "
        + ".".join(map(str, sys.version_info[:3]))
    )

from litegrip_client.threads.actions import GripperActions, ManualCalibration, SetpointStream
from litegrip_client.threads.gripper import LiteGrip
from litegrip_client.values.errors import (
    BusyError,
    CancelledError,
    CANTimeoutError,
    CommandError,
    CommError,
    ConnectError,
    ErrorCode,
    HardwareError,
    LeaseError,
    LiteGripError,
    NotInitializedError,
    NotPermittedError,
    ParameterError,
    ProtocolError,
    StoppedError,
    TeleopBusyError,
    TeleopError,
    TeleopNotActiveError,
    TeleopNotReady,
    TrajectoryBusyError,
    TrajectoryEmptyError,
    TrajectoryError,
    TrajectoryFormatError,
    TrajectoryNotActiveError,
    TrajectoryNotFoundError,
    TrajectoryRecordingError,
    describe_error,
)

TYPE_CHECKING = False
if TYPE_CHECKING:
    from litegrip_client import aio as aio
    from litegrip_client.line.feeds import Event
    from litegrip_client.sdk.names import (
        DEFAULT_DQ_MAX,
        DEFAULT_GRIP_ID,
        DEFAULT_GRIP_PORT,
        DEFAULT_TORQUE_LIMIT_NM,
        FRAME_SIZE,
        MAX_FRAME_GAP_S,
        TORQUE_REARM_OPENNESS,
        TORQUE_TRIP_CYCLES,
        Control_Mode,
        DefaultParams,
        DM_Motor_Type,
        GripperInfo,
        GripperMode,
        GripperParams,
        GripperStatus,
        decode_frame,
        encode_frame,
        teleop_topic,
    )
    from litegrip_client.sdk.refused import (
        Connector,
        GripperTeleop,
        InProcTeleopTransport,
        LatestSlot,
        Listener,
        TeleopSubscription,
        TeleopTransport,
        TrajectoryPlayer,
        TrajectoryRecorder,
        UdpTeleopTransport,
        ZenohTeleopTransport,
        can,
        check_ready,
        clamp_to_calibrated,
        limit_target,
        press_target,
    )
    from litegrip_client.values.calibration import CalibrationData, GripperConfig, UnitConversion
    from litegrip_client.values.calibration_files import (
        CALIB_TEMPLATES,
        DEFAULT_CALIB,
        default_calib_path,
        list_templates,
    )
    from litegrip_client.values.motion_config import MotionConfig
    from litegrip_client.values.results import (
        EnableResult,
        GraspResult,
        GripperState,
        MoveProgress,
        MoveResult,
        PlayResult,
        SetZeroResult,
    )
    from litegrip_client.values.trajectory import (
        DEFAULT_RATE_HZ,
        Trajectory,
        TrajectoryFile,
        TrajectorySample,
        list_trajectories,
        resolve_path,
        trajectory_dir,
    )
    from litegrip_client.values.trajectory_format import TaughtGrip

    __version__: str

__all__ = [
    "CALIB_TEMPLATES",
    "DEFAULT_CALIB",
    "DEFAULT_DQ_MAX",
    "DEFAULT_GRIP_ID",
    "DEFAULT_GRIP_PORT",
    "DEFAULT_RATE_HZ",
    "DEFAULT_TORQUE_LIMIT_NM",
    "FRAME_SIZE",
    "MAX_FRAME_GAP_S",
    "TORQUE_REARM_OPENNESS",
    "TORQUE_TRIP_CYCLES",
    "BusyError",
    "CANTimeoutError",
    "CalibrationData",
    "CancelledError",
    "CommError",
    "CommandError",
    "ConnectError",
    "Connector",
    "Control_Mode",
    "DM_Motor_Type",
    "DefaultParams",
    "EnableResult",
    "ErrorCode",
    "Event",
    "GraspResult",
    "GripperActions",
    "GripperConfig",
    "GripperInfo",
    "GripperMode",
    "GripperParams",
    "GripperState",
    "GripperStatus",
    "GripperTeleop",
    "HardwareError",
    "InProcTeleopTransport",
    "LatestSlot",
    "LeaseError",
    "Listener",
    "LiteGrip",
    "LiteGripError",
    "ManualCalibration",
    "MotionConfig",
    "MoveProgress",
    "MoveResult",
    "NotInitializedError",
    "NotPermittedError",
    "ParameterError",
    "PlayResult",
    "ProtocolError",
    "SetZeroResult",
    "SetpointStream",
    "StoppedError",
    "TaughtGrip",
    "TeleopBusyError",
    "TeleopError",
    "TeleopNotActiveError",
    "TeleopNotReady",
    "TeleopSubscription",
    "TeleopTransport",
    "Trajectory",
    "TrajectoryBusyError",
    "TrajectoryEmptyError",
    "TrajectoryError",
    "TrajectoryFile",
    "TrajectoryFormatError",
    "TrajectoryNotActiveError",
    "TrajectoryNotFoundError",
    "TrajectoryPlayer",
    "TrajectoryRecorder",
    "TrajectoryRecordingError",
    "TrajectorySample",
    "UdpTeleopTransport",
    "UnitConversion",
    "ZenohTeleopTransport",
    "__version__",
    "can",
    "check_ready",
    "clamp_to_calibrated",
    "decode_frame",
    "default_calib_path",
    "describe_error",
    "encode_frame",
    "limit_target",
    "list_templates",
    "list_trajectories",
    "press_target",
    "resolve_path",
    "teleop_topic",
    "trajectory_dir",
]

_LATER = {
    **dict.fromkeys(
        (
            "Connector",
            "GripperTeleop",
            "InProcTeleopTransport",
            "LatestSlot",
            "Listener",
            "TeleopSubscription",
            "TeleopTransport",
            "TrajectoryPlayer",
            "TrajectoryRecorder",
            "UdpTeleopTransport",
            "ZenohTeleopTransport",
            "can",
            "check_ready",
            "clamp_to_calibrated",
            "limit_target",
            "press_target",
        ),
        "sdk.refused",
    ),
    **dict.fromkeys(
        (
            "Control_Mode",
            "DM_Motor_Type",
            "DefaultParams",
            "GripperInfo",
            "GripperMode",
            "GripperParams",
            "GripperStatus",
            "DEFAULT_DQ_MAX",
            "DEFAULT_GRIP_ID",
            "DEFAULT_GRIP_PORT",
            "DEFAULT_TORQUE_LIMIT_NM",
            "FRAME_SIZE",
            "MAX_FRAME_GAP_S",
            "TORQUE_REARM_OPENNESS",
            "TORQUE_TRIP_CYCLES",
            "decode_frame",
            "encode_frame",
            "teleop_topic",
        ),
        "sdk.names",
    ),
    "CALIB_TEMPLATES": "values.calibration_files",
    "DEFAULT_CALIB": "values.calibration_files",
    "default_calib_path": "values.calibration_files",
    "CalibrationData": "values.calibration",
    "EnableResult": "values.results",
    "Event": "line.feeds",
    "GraspResult": "values.results",
    "GripperConfig": "values.calibration",
    "GripperState": "values.results",
    "MotionConfig": "values.motion_config",
    "MoveProgress": "values.results",
    "MoveResult": "values.results",
    "PlayResult": "values.results",
    "SetZeroResult": "values.results",
    "TaughtGrip": "values.trajectory_format",
    "Trajectory": "values.trajectory",
    "TrajectoryFile": "values.trajectory",
    "TrajectorySample": "values.trajectory",
    "UnitConversion": "values.calibration",
    "list_templates": "values.calibration_files",
    "list_trajectories": "values.trajectory",
    "DEFAULT_RATE_HZ": "values.trajectory",
    "resolve_path": "values.trajectory",
    "trajectory_dir": "values.trajectory",
}
"""Names that are slow to import or seldom needed, and their modules."""


def __getattr__(name: str) -> object:
    """Return a name that is imported on first use."""
    if name in _LATER:
        from importlib import import_module  # noqa: PLC0415

        return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
    if name == "aio":
        from importlib import import_module  # noqa: PLC0415

        return import_module(f"{__name__}.aio")
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

        try:
            return version("litegripd")
        except PackageNotFoundError:
            return "0.0.0+source"
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
