"""The client's exceptions, and how the daemon's error objects become them.

`_error_table` maps each reason to its exception; it is generated from the daemon's own table.
This module must not know single reasons.
"""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client._error_table import CODES, REASONS

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.voices import Voice

INTERNAL_EXIT_CODE = 70
"""For what has no better exit code: EX_SOFTWARE of sysexits.h."""


class LiteGripError(Exception):
    """A refusal or a failure of the daemon or of the connection to it.

    `reason` is stable and meant for programs (see docs/errors.md). `code` is the JSON-RPC error
    code, or None for an error that the client found itself. `message` is a sentence for a person;
    `data` is everything else that came with the error.
    """

    def __init__(
        self,
        message: str,
        *,
        reason: str | None = None,
        code: int | None = None,
        data: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.reason = reason
        self.code = code
        self.data: dict[str, Any] = dict(data or {})

    @property
    def retryable(self) -> bool:
        """True if the same request may succeed later unchanged."""
        return self.data.get("retryable") is True

    @property
    def hint(self) -> str | None:
        """What to do about the error, or None."""
        hint = self.data.get("hint")
        return hint if isinstance(hint, str) else None

    @property
    def owner(self) -> dict[str, Any] | None:
        """The present owner of the requested resource: a mapping with pid, program and so on."""
        owner = self.data.get("owner")
        return owner if isinstance(owner, dict) else None

    def __str__(self) -> str:
        from litegrip_client.voices import is_said  # noqa: PLC0415 - only errors need it

        hint = self.hint
        return (
            self.message if not hint or is_said(self.message, hint) else f"{self.message}\n{hint}"
        )


class ProtocolError(LiteGripError):
    """Client and daemon use different protocols, or one of them violates the protocol."""


class CommandError(LiteGripError):
    """The daemon refuses the request as it stands."""


class TrajectoryError(CommandError, ValueError):
    """A trajectory, or its taught grips, that cannot be used. Also a builtin `ValueError`."""

    def __init__(self, message: str) -> None:
        super().__init__(message, reason="trajectory_unreadable")


class HardwareError(LiteGripError):
    """The motor or its bus cannot execute the request."""


class ConnectError(LiteGripError, ConnectionError):
    """No daemon answers, or the connection is lost. Also a builtin `ConnectionError`."""


class BusyError(CommandError):
    """Another motion is running, or too many requests came at once."""


class TrajectoryBusyError(BusyError):
    """A trajectory is being recorded or replayed."""


class TeleopBusyError(BusyError):
    """Teleoperation is running: end it with `teleop_stop`."""


class TeleopNotReady(CommandError):  # noqa: N818 - the vendor SDK's name
    """Teleoperation needs a calibrated gripper whose motor is enabled."""


class LeaseError(BusyError):
    """Another client has the lease, or this client lost it; see `owner`."""


class NotPermittedError(CommandError):
    """The user's role in the daemon's configuration does not allow the request."""


class StoppedError(CommandError):
    """A stop is latched, or came after the request was sent."""


class CancelledError(CommandError):
    """The motion was cancelled before it ended by itself."""


_CLASSES: Mapping[str, type[LiteGripError]] = {
    kind.__name__: kind
    for kind in (
        LiteGripError,
        ProtocolError,
        CommandError,
        HardwareError,
        ConnectError,
        BusyError,
        TrajectoryBusyError,
        LeaseError,
        NotPermittedError,
        StoppedError,
        CancelledError,
        TeleopBusyError,
        TeleopNotReady,
    )
}


def from_error_object(
    error: Any, method: str | None = None, voice: Voice | None = None
) -> LiteGripError:
    """Return the exception for the error object of an answer to `method`.

    Its message and hint are put into the words of a `voice`, that of Python unless given.

    A reason that this version does not know, from a newer daemon, becomes the exception of its
    code, and `LiteGripError` when the code is unknown as well.
    """
    if not isinstance(error, dict):
        return ProtocolError(f"the daemon sent an error that is no object: {error!r:.80}")
    data = error.get("data")
    data = dict(data) if isinstance(data, dict) else {}
    if voice is None:
        from litegrip_client.voices import in_python  # noqa: PLC0415 - only errors need it

        voice = in_python
    parameter = data.get("parameter") or data.get("field")
    if isinstance(data.get("hint"), str):
        data["hint"] = voice(data["hint"], method, parameter)
    reason, code = data.get("reason"), error.get("code")
    row = REASONS.get(reason) if isinstance(reason, str) else None
    if row is None and isinstance(code, int):
        row = REASONS.get(CODES.get(code, ""))
    kind = _CLASSES.get(row[0], LiteGripError) if row is not None else LiteGripError
    return kind(
        voice(str(error.get("message", "the daemon gave no message")), method, parameter),
        reason=reason if isinstance(reason, str) else None,
        code=code if isinstance(code, int) else None,
        data=data,
    )


def exit_code(error: LiteGripError) -> int:
    """Return the exit code of `litegripctl` for an error: by reason, else by its class."""
    row = REASONS.get(error.reason or "")
    if row is not None:
        return row[1]
    name = type(error).__name__
    return next((code for kind, code in REASONS.values() if kind == name), INTERNAL_EXIT_CODE)
