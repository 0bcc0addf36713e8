"""The vendor SDK's package, for grippers that a daemon drives: its names, over `litegrip_client`.

    from litegrip import LiteGrip

`python -m litegrip_client.as_sdk script.py` runs a script with this package; the distribution
litegrip-compat installs it. What differs from the SDK is in docs/generated/sdk-compat.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _beside

_beside.check(Path(__file__).resolve().parent.parent)

from . import can  # noqa: E402 - not before the check
from .actions import (  # noqa: E402
    EnableResult,
    GraspResult,
    GripperActions,
    MotionConfig,
    MoveProgress,
    MoveResult,
    WriteZeroResult,
    limit_target,
    press_target,
    work_limit_target,
)
from .constants import (  # noqa: E402
    Control_Mode,
    DefaultParams,
    DM_Motor_Type,
    ErrorCode,
    GripperGeometry,
    GripperParams,
    UnitConversion,
    describe_error,
)
from .exceptions import (  # noqa: E402
    CANTimeoutError,
    CommandError,
    CommError,
    ConnectError,
    HardwareError,
    LiteGripError,
    NotInitializedError,
)
from .gripper import (  # noqa: E402
    CALIB_TEMPLATES,
    DEFAULT_CALIB,
    LiteGrip,
    default_calib_path,
    list_templates,
)
from .models import (  # noqa: E402
    CalibrationData,
    GripperConfig,
    GripperInfo,
    GripperMode,
    GripperState,
    GripperStatus,
)
from .teleop import (  # noqa: E402
    DEFAULT_ALIGN_SPEED_MM_S,
    DEFAULT_DQ_MAX,
    DEFAULT_GRIP_ID,
    DEFAULT_GRIP_PORT,
    DEFAULT_LEAD_CAP_MM,
    DEFAULT_READY_PERIOD_S,
    DEFAULT_READY_TIMEOUT_S,
    DEFAULT_READY_TOLERANCE_MM,
    DEFAULT_TORQUE_LIMIT_NM,
    FRAME_SIZE,
    READY_FRAME_SIZE,
    GripperTeleop,
    InProcTeleopTransport,
    TeleopBusyError,
    TeleopError,
    TeleopNotActiveError,
    TeleopNotReady,
    TeleopSubscription,
    TeleopTransport,
    UdpTeleopTransport,
    check_ready,
    clamp_to_calibrated,
    decode_frame,
    decode_ready_frame,
    encode_frame,
    encode_ready_frame,
    ready_topic,
    teleop_topic,
)
from .trajectory import (  # noqa: E402
    DEFAULT_RATE_HZ,
    Trajectory,
    TrajectoryBusyError,
    TrajectoryEmptyError,
    TrajectoryError,
    TrajectoryFormatError,
    TrajectoryNotActiveError,
    TrajectoryPlayer,
    TrajectoryRecorder,
    TrajectoryRecordingError,
    TrajectorySample,
    resolve_path,
    trajectory_dir,
)

if TYPE_CHECKING:
    from .zenoh_link import Connector as Connector
    from .zenoh_link import LatestSlot as LatestSlot
    from .zenoh_link import Listener as Listener
    from .zenoh_link import ZenohTeleopTransport as ZenohTeleopTransport

    __version__: str

__all__ = [  # noqa: RUF022 - the SDK's order
    "__version__",
    "LiteGrip",
    "DEFAULT_CALIB",
    "CALIB_TEMPLATES",
    "default_calib_path",
    "list_templates",
    "MotionConfig",
    "MoveProgress",
    "MoveResult",
    "GraspResult",
    "EnableResult",
    "WriteZeroResult",
    "GripperActions",
    "limit_target",
    "press_target",
    "work_limit_target",
    "GripperState",
    "GripperConfig",
    "GripperInfo",
    "GripperStatus",
    "GripperMode",
    "CalibrationData",
    "GripperGeometry",
    "GripperParams",
    "UnitConversion",
    "ErrorCode",
    "DefaultParams",
    "describe_error",
    "DM_Motor_Type",
    "Control_Mode",
    "LiteGripError",
    "CommError",
    "ConnectError",
    "CommandError",
    "CANTimeoutError",
    "HardwareError",
    "NotInitializedError",
    "GripperTeleop",
    "TeleopTransport",
    "TeleopSubscription",
    "UdpTeleopTransport",
    "InProcTeleopTransport",
    "TeleopError",
    "TeleopBusyError",
    "TeleopNotActiveError",
    "TeleopNotReady",
    "check_ready",
    "clamp_to_calibrated",
    "DEFAULT_GRIP_ID",
    "DEFAULT_GRIP_PORT",
    "DEFAULT_DQ_MAX",
    "DEFAULT_ALIGN_SPEED_MM_S",
    "DEFAULT_LEAD_CAP_MM",
    "DEFAULT_TORQUE_LIMIT_NM",
    "DEFAULT_READY_TOLERANCE_MM",
    "DEFAULT_READY_PERIOD_S",
    "DEFAULT_READY_TIMEOUT_S",
    "FRAME_SIZE",
    "READY_FRAME_SIZE",
    "encode_frame",
    "decode_frame",
    "encode_ready_frame",
    "decode_ready_frame",
    "teleop_topic",
    "ready_topic",
    "Trajectory",
    "TrajectorySample",
    "TrajectoryRecorder",
    "TrajectoryPlayer",
    "trajectory_dir",
    "resolve_path",
    "DEFAULT_RATE_HZ",
    "TrajectoryError",
    "TrajectoryBusyError",
    "TrajectoryNotActiveError",
    "TrajectoryEmptyError",
    "TrajectoryRecordingError",
    "TrajectoryFormatError",
    "can",
]

_OF_ZENOH = ("Connector", "LatestSlot", "Listener", "ZenohTeleopTransport")


def __getattr__(name: str) -> Any:
    """Import what needs zenoh, and look up the version, when somebody asks for it."""
    if name in _OF_ZENOH:
        from . import zenoh_link  # noqa: PLC0415 - zenoh may be missing

        return getattr(zenoh_link, name)
    if name == "__version__":
        from importlib import metadata  # noqa: PLC0415 - slow

        try:
            found = metadata.version(_beside.DISTRIBUTION)
        except metadata.PackageNotFoundError:
            found = "0.0.0+source"
        globals()[name] = found
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_OF_ZENOH})
