"""Drive a LiteGrip gripper through its daemon, with the vendor SDK's names.

    from litegrip_client import LiteGrip

    with LiteGrip("can0") as gripper:
        gripper.enable()
        gripper.close()

Standard library only; nothing of the daemon is imported. And little of the library: `typing`
and `dataclasses` take as long to import as all the rest, so the modules need the first only for
the type checker (which knows what `TYPE_CHECKING` means, wherever it comes from), and the second
when the first connection is made.
"""

from __future__ import annotations

from litegrip_client.actions import GripperActions
from litegrip_client.errors import (
    BusyError,
    CancelledError,
    CommandError,
    ConnectError,
    HardwareError,
    LiteGripError,
    ProtocolError,
    StoppedError,
)
from litegrip_client.gripper import LiteGrip

TYPE_CHECKING = False
if TYPE_CHECKING:
    from litegrip_client.results import EnableResult, GripperState, MoveProgress, MoveResult

__all__ = [
    "BusyError",
    "CancelledError",
    "CommandError",
    "ConnectError",
    "EnableResult",
    "GripperActions",
    "GripperState",
    "HardwareError",
    "LiteGrip",
    "LiteGripError",
    "MoveProgress",
    "MoveResult",
    "ProtocolError",
    "StoppedError",
]


_RESULTS = {"EnableResult", "GripperState", "MoveProgress", "MoveResult"}


def __getattr__(name: str) -> object:
    """Find what takes long to import, when it is asked for."""
    if name in _RESULTS:
        from litegrip_client import results  # noqa: PLC0415

        return getattr(results, name)
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

        try:
            return version("litegripd")
        except PackageNotFoundError:
            return "0.0.0+source"
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
