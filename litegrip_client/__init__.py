"""Drive a LiteGrip gripper through its daemon, with the vendor SDK's names.

    from litegrip_client import LiteGrip

    with LiteGrip("can0") as gripper:
        gripper.enable()
        gripper.close()

`litegrip_client.aio` offers the same on asyncio. It is imported on first use.

The client uses the standard library only and imports nothing of the daemon. Each name here is
imported on its first use, with its module: `litegripctl stop` needs none of them.

What starts quickly is counted by `python -m bench.timing.startup`; 4 million instructions are about
a millisecond. `typing` takes 3 ms and `dataclasses` 10 ms. So what `litegripctl` or `LiteGrip`
needs at its start imports `typing` only for the type checker (which knows `TYPE_CHECKING`, whatever
its origin), and what takes over 2 ms in the function that needs it.
"""

from __future__ import annotations

import sys
from importlib import import_module

if sys.version_info < (3, 10):  # noqa: UP036 - a copy beside a script was installed by no pip
    raise ImportError(
        "litegrip_client needs Python 3.10 or newer, this is "
        + ".".join(map(str, sys.version_info[:3]))
    )

TYPE_CHECKING = False
if TYPE_CHECKING:  # the names again, for who reads them without running this
    from litegrip_client import aio as aio
    from litegrip_client.line.feeds import (
        Event,
    )
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
    from litegrip_client.threads.actions import (
        GripperActions,
        ManualCalibration,
        SetpointStream,
    )
    from litegrip_client.threads.gripper import (
        LiteGrip,
    )
    from litegrip_client.values.calibration import (
        CalibrationData,
        GripperConfig,
        UnitConversion,
    )
    from litegrip_client.values.calibration_files import (
        CALIB_TEMPLATES,
        DEFAULT_CALIB,
        default_calib_path,
        list_templates,
    )
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
    from litegrip_client.values.motion_config import (
        MotionConfig,
    )
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
    from litegrip_client.values.trajectory_format import (
        TaughtGrip,
    )

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

_MODULES = {
    "line.feeds": ("Event",),
    "sdk.names": (
        "Control_Mode",
        "DEFAULT_DQ_MAX",
        "DEFAULT_GRIP_ID",
        "DEFAULT_GRIP_PORT",
        "DEFAULT_TORQUE_LIMIT_NM",
        "DM_Motor_Type",
        "DefaultParams",
        "FRAME_SIZE",
        "GripperInfo",
        "GripperMode",
        "GripperParams",
        "GripperStatus",
        "MAX_FRAME_GAP_S",
        "TORQUE_REARM_OPENNESS",
        "TORQUE_TRIP_CYCLES",
        "decode_frame",
        "encode_frame",
        "teleop_topic",
    ),
    "sdk.refused": (
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
    "threads.actions": (
        "GripperActions",
        "ManualCalibration",
        "SetpointStream",
    ),
    "threads.gripper": ("LiteGrip",),
    "values.calibration": (
        "CalibrationData",
        "GripperConfig",
        "UnitConversion",
    ),
    "values.calibration_files": (
        "CALIB_TEMPLATES",
        "DEFAULT_CALIB",
        "default_calib_path",
        "list_templates",
    ),
    "values.errors": (
        "BusyError",
        "CANTimeoutError",
        "CancelledError",
        "CommError",
        "CommandError",
        "ConnectError",
        "ErrorCode",
        "HardwareError",
        "LeaseError",
        "LiteGripError",
        "NotInitializedError",
        "NotPermittedError",
        "ParameterError",
        "ProtocolError",
        "StoppedError",
        "TeleopBusyError",
        "TeleopError",
        "TeleopNotActiveError",
        "TeleopNotReady",
        "TrajectoryBusyError",
        "TrajectoryEmptyError",
        "TrajectoryError",
        "TrajectoryFormatError",
        "TrajectoryNotActiveError",
        "TrajectoryNotFoundError",
        "TrajectoryRecordingError",
        "describe_error",
    ),
    "values.motion_config": ("MotionConfig",),
    "values.results": (
        "EnableResult",
        "GraspResult",
        "GripperState",
        "MoveProgress",
        "MoveResult",
        "PlayResult",
        "SetZeroResult",
    ),
    "values.trajectory": (
        "DEFAULT_RATE_HZ",
        "Trajectory",
        "TrajectoryFile",
        "TrajectorySample",
        "list_trajectories",
        "resolve_path",
        "trajectory_dir",
    ),
    "values.trajectory_format": ("TaughtGrip",),
}
"""The modules of the names."""

_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    """Return a name, imported on its first use."""
    if name == "aio":
        return import_module(f"{__name__}.aio")
    if name == "__version__":
        from litegrip_client.values.version import client_version  # noqa: PLC0415

        return client_version()
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value
