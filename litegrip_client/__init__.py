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
    from litegrip_client.line.latest import (
        Latest,
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
    "DEFAULT_RATE_HZ",
    "BusyError",
    "CANTimeoutError",
    "CalibrationData",
    "CancelledError",
    "CommError",
    "CommandError",
    "ConnectError",
    "EnableResult",
    "ErrorCode",
    "Event",
    "GraspResult",
    "GripperActions",
    "GripperConfig",
    "GripperState",
    "HardwareError",
    "Latest",
    "LeaseError",
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
    "Trajectory",
    "TrajectoryBusyError",
    "TrajectoryEmptyError",
    "TrajectoryError",
    "TrajectoryFile",
    "TrajectoryFormatError",
    "TrajectoryNotActiveError",
    "TrajectoryNotFoundError",
    "TrajectoryRecordingError",
    "TrajectorySample",
    "UnitConversion",
    "__version__",
    "default_calib_path",
    "describe_error",
    "list_templates",
    "list_trajectories",
    "resolve_path",
    "trajectory_dir",
]

_MODULES = {
    "line.feeds": ("Event",),
    "line.latest": ("Latest",),
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


def __dir__() -> list[str]:
    """Return the public names, for who completes them: before their first use they are not here."""
    return sorted({*__all__, "aio", *(name for name in globals() if name.startswith("__"))})
