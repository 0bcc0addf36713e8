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

from litegrip_client.actions import GripperActions, ManualCalibration, SetpointStream
from litegrip_client.errors import (
    BusyError,
    CancelledError,
    CommandError,
    ConnectError,
    HardwareError,
    LeaseError,
    LiteGripError,
    NotPermittedError,
    ProtocolError,
    StoppedError,
    TeleopBusyError,
    TeleopNotReady,
    TrajectoryBusyError,
)
from litegrip_client.gripper import LiteGrip

TYPE_CHECKING = False
if TYPE_CHECKING:
    from litegrip_client import aio as aio
    from litegrip_client.calibration import CalibrationData, GripperConfig
    from litegrip_client.calibration_files import CALIB_TEMPLATES, list_templates
    from litegrip_client.conversion import UnitConversion
    from litegrip_client.feeds import Event
    from litegrip_client.motion_config import MotionConfig
    from litegrip_client.protocol.grips import TaughtGrip
    from litegrip_client.results import (
        EnableResult,
        GraspResult,
        GripperState,
        MoveProgress,
        MoveResult,
        PlayResult,
        SetZeroResult,
    )
    from litegrip_client.trajectory import Trajectory, TrajectorySample
    from litegrip_client.trajectory_files import TrajectoryFile, list_trajectories

    __version__: str

__all__ = [
    "CALIB_TEMPLATES",
    "BusyError",
    "CalibrationData",
    "CancelledError",
    "CommandError",
    "ConnectError",
    "EnableResult",
    "Event",
    "GraspResult",
    "GripperActions",
    "GripperConfig",
    "GripperState",
    "HardwareError",
    "LeaseError",
    "LiteGrip",
    "LiteGripError",
    "ManualCalibration",
    "MotionConfig",
    "MoveProgress",
    "MoveResult",
    "NotPermittedError",
    "PlayResult",
    "ProtocolError",
    "SetZeroResult",
    "SetpointStream",
    "StoppedError",
    "TaughtGrip",
    "TeleopBusyError",
    "TeleopNotReady",
    "Trajectory",
    "TrajectoryBusyError",
    "TrajectoryFile",
    "TrajectorySample",
    "UnitConversion",
    "__version__",
    "list_templates",
    "list_trajectories",
]

_LATER = {
    "CALIB_TEMPLATES": "calibration_files",
    "CalibrationData": "calibration",
    "EnableResult": "results",
    "Event": "feeds",
    "GraspResult": "results",
    "GripperConfig": "calibration",
    "GripperState": "results",
    "MotionConfig": "motion_config",
    "MoveProgress": "results",
    "MoveResult": "results",
    "PlayResult": "results",
    "SetZeroResult": "results",
    "TaughtGrip": "protocol.grips",
    "Trajectory": "trajectory",
    "TrajectoryFile": "trajectory_files",
    "TrajectorySample": "trajectory",
    "UnitConversion": "conversion",
    "list_templates": "calibration_files",
    "list_trajectories": "trajectory_files",
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
