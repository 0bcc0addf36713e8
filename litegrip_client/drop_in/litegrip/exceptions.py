"""The SDK's exceptions: the seven of this module, and those of teleoperation and trajectories.

A failure that the daemon reports is raised as one of them; the client's own error, with its
`reason`, `hint` and `owner`, is its `__context__`, which a traceback does not print.
"""

from __future__ import annotations

__all__ = [
    "CANTimeoutError",
    "CommError",
    "CommandError",
    "ConnectError",
    "HardwareError",
    "LiteGripError",
    "NotInitializedError",
]


class LiteGripError(Exception):
    """Any failure. `message` is a sentence, `error_code` the motor's status if it named one."""

    def __init__(self, message: str, error_code: int | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.error_code = error_code

    def __str__(self) -> str:
        if self.error_code is None:
            return self.message
        return f"{self.message} [0x{self.error_code:04X}]"


class CommError(LiteGripError):
    """Frames could not be exchanged: the bus is down, or the daemon is gone."""


class ConnectError(LiteGripError):
    """`connect()` has failed: no daemon answers for this channel."""


class CommandError(LiteGripError):
    """The request is refused as it stands: its arguments, no calibration, a stop, a lease."""


class CANTimeoutError(LiteGripError):
    """The motor does not answer."""


class HardwareError(LiteGripError):
    """The motor could not be enabled, or its fault not be cleared."""


class NotInitializedError(LiteGripError):
    """The gripper is not connected, or its motor not enabled."""
