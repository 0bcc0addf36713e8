"""The client's exceptions, how the daemon's error objects become them, and the reasons of both."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

from litegrip_client.values.error_table import CODES, REASONS

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.values.terms import Voice

OWN_REASONS: Mapping[str, tuple[str, int, str]] = {
    "no_daemon": ("ConnectError", 3, "No daemon can be reached by the sockets of the channel."),
    "no_answer": ("ConnectError", 3, "The daemon does not answer in time."),
    "connection_lost": ("ConnectError", 3, "The connection to the daemon is gone."),
    "closed": ("ConnectError", 3, "This program has closed the connection."),
    "not_connected": ("ConnectError", 3, "The object is not connected, or no longer."),
    "forked": ("ConnectError", 3, "The connection belongs to the process before the fork."),
    "wrong_loop": ("CommandError", 4, "The connection belongs to another event loop."),
    "reentrant": ("CommandError", 4, "The thread waits for an answer there already."),
    "wrong_protocol": ("ProtocolError", 70, "The daemon speaks another version of the protocol."),
    "older_daemon": ("CommandError", 4, "The daemon is older, and lacks what it was asked for."),
    "missing_field": ("ProtocolError", 70, "Something is missing in what the daemon sent."),
    "wrong_gripper": ("CommandError", 4, "The daemon has another channel or motor than named."),
    "unsupported": ("CommandError", 4, "What the SDK can do, but not through a daemon."),
    "not_begun": ("CommandError", 4, "No calibration by hand is under way."),
    "file_exists": ("CommandError", 4, "There is a file or a trajectory of that name."),
    "file_not_read": ("CommandError", 4, "A file cannot be read from here."),
    "file_not_written": ("CommandError", 4, "A file cannot be written."),
    "dump_unreadable": ("CommandError", 4, "A file is no dump of the flight recorder."),
    "library_missing": (
        "CommandError",
        4,
        "The command needs a library or a program that is missing.",
    ),
    "not_simulated": (
        "CommandError",
        4,
        "The gripper is a real one; only a simulated one has that.",
    ),
    "wrong_usage": ("CommandError", 2, "The command line of `litegripctl` is wrong."),
    "not_wanted": ("CommandError", 1, "You said no; nothing was done."),
    "interrupted": ("CancelledError", 130, "Ctrl-C ended it."),
}
"""By reason: the exception, the exit code of `litegripctl`, and what it means."""


INTERNAL_EXIT_CODE = 70
"""For what has no better exit code: EX_SOFTWARE of sysexits.h."""


class ErrorCode(IntEnum):
    """The motor's status nibble, `error_code` of a state (maker's table)."""

    DISABLED = 0x0
    ENABLED = 0x1
    OVER_VOLTAGE = 0x8
    UNDER_VOLTAGE = 0x9
    OVER_CURRENT = 0xA
    DRIVER_HOT = 0xB
    COIL_HOT = 0xC
    COMMUNICATION_LOST = 0xD
    OVERLOAD = 0xE


STATUS_CODES = {code.name.lower(): int(code) for code in ErrorCode}
"""A status as the daemon names it: its nibble."""


def describe_error(code: int) -> str:
    """Return a status nibble in words; an unknown one by its number."""
    try:
        return ErrorCode(code).name.replace("_", " ").lower()
    except ValueError:
        return f"unknown status {code}"


class Origin:
    """The gripper whose calls raise an error; `is_one_of_several` while a program has others."""

    __slots__ = ("channel", "is_one_of_several")

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self.is_one_of_several = False


_ON_PURPOSE = ("stopped", "taken")
"""Causes in the data of an error: somebody has stopped the gripper, or taken its lease."""


class LiteGripError(Exception):
    """A refusal or a failure of the daemon or of the connection to it.

    `reason` is stable and meant for programs (see docs/errors.md). `code` is the JSON-RPC error
    code, or None for an error that the client found itself. `message` is a sentence for a person;
    `data` is everything else that came with the error. `channel` is that of the gripper object
    whose call has raised it, None for what no connected or connecting gripper has raised. In a
    program that is connected to several channels at once, `str(error)` begins with it.
    """

    origin: Origin | None = None
    """The gripper of `channel`."""
    named: frozenset[str] = frozenset()
    """The daemon's methods that the message names."""
    remedy: frozenset[str] = frozenset()
    """Those that the hint names."""
    is_told = False
    """True if another error or warning has said already what this one does."""

    def __init__(
        self,
        message: str = "",
        error_code: int | None = None,
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
        self._error_code = error_code

    @property
    def error_code(self) -> int | None:
        """The motor's status nibble if it is the reason (see `describe_error`), else None."""
        if self._error_code is None and self.reason == "motor_fault":
            return STATUS_CODES.get(str(self.data.get("status")))
        return self._error_code

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
        """Who has what was asked for, has taken it, or has stopped: pid, program and so on.

        None if nobody has: a lease that was lost may have run out.
        """
        owner = self.data.get("owner", self.data.get("by"))
        return owner if isinstance(owner, dict) else None

    @property
    def channel(self) -> str | None:
        """The channel of the gripper whose call has raised the error, or None."""
        return None if self.origin is None else self.origin.channel

    def __str__(self) -> str:
        # Only beside another gripper: a program that has one knows which it is, and its messages
        # stay as they are. Some begin so already, for what the log says at the end of a block.
        origin = self.origin
        if origin is None or not origin.is_one_of_several:
            return self.text
        is_named = self.message.startswith(f"{origin.channel}: ")
        return self.text if is_named else f"{origin.channel}: {self.text}"

    @property
    def text(self) -> str:
        """What the error says and, where that is not in it, the hint."""
        hint = self.hint
        if not hint or hint in self.message or self.names(self.remedy):
            return self.message
        is_call = hint.endswith(")") and " " not in hint.removeprefix("await ")
        if not is_call:
            return f"{self.message}\n{hint}"
        # What somebody has ended on purpose may have been dangerous: the call is no mere next step.
        is_of_somebody = isinstance(self, StoppedError) or self.data.get("cause") in _ON_PURPOSE
        return f"{self.message}\n{'when it is safe' if is_of_somebody else 'next'}: {hint}"

    def names(self, methods: frozenset[str]) -> bool:
        """Return True if the message names all these methods of the daemon, and there are some."""
        return bool(methods) and methods <= self.named


class ProtocolError(LiteGripError):
    """Client and daemon use different protocols, or one of them violates the protocol."""


class CommandError(LiteGripError):
    """The daemon refuses the request as it stands."""


class ParameterError(CommandError, ValueError):
    """A value that cannot be, or not here. Also a builtin `ValueError`."""


class HardwareError(LiteGripError):
    """The motor or its bus cannot execute the request."""


class NotInitializedError(HardwareError):
    """The motor is not enabled."""


class CommError(HardwareError):
    """The bus cannot be used, or the motor does not answer on it."""


class CANTimeoutError(CommError):
    """The motor does not answer."""


class ConnectError(LiteGripError, ConnectionError):
    """No daemon answers, or the connection is lost. Also a builtin `ConnectionError`."""


class BusyError(CommandError):
    """Another motion is running, or too many requests came at once."""


class TrajectoryError(CommandError):
    """A trajectory cannot be recorded, replayed, read or written."""


class TrajectoryBusyError(BusyError, TrajectoryError):
    """A trajectory is being recorded or replayed."""


class TrajectoryFormatError(TrajectoryError, ValueError):
    """A trajectory, or its taught grips, that cannot be used. Also a builtin `ValueError`."""

    def __init__(
        self,
        message: str,
        error_code: int | None = None,
        *,
        reason: str | None = "trajectory_unreadable",
        code: int | None = None,
        data: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(message, error_code, reason=reason, code=code, data=data)


class TrajectoryNotFoundError(TrajectoryError, FileNotFoundError):
    """There is no such trajectory. Also a builtin `FileNotFoundError`."""


class TrajectoryRecordingError(TrajectoryError):
    """A recording was broken off, or did not fill."""


class TrajectoryEmptyError(TrajectoryRecordingError):
    """A recording has no samples."""


class TrajectoryNotActiveError(TrajectoryError):
    """No replay is running, or no recording, and none has ended that could be fetched."""


class TeleopError(CommandError):
    """Teleoperation cannot begin or continue."""


class TeleopBusyError(BusyError, TeleopError):
    """Teleoperation is running: end it with `teleop_stop`."""


class TeleopNotActiveError(TeleopError):
    """Teleoperation is not running."""


class TeleopNotReady(TeleopError):  # noqa: N818 - the vendor SDK's name
    """Teleoperation needs a calibrated gripper whose motor is enabled."""


class LeaseError(BusyError):
    """Another client has the lease, or this client lost it; `owner` is who has, or has taken it."""


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
        ParameterError,
        HardwareError,
        NotInitializedError,
        CommError,
        CANTimeoutError,
        ConnectError,
        BusyError,
        TrajectoryBusyError,
        TrajectoryFormatError,
        TrajectoryNotFoundError,
        TrajectoryRecordingError,
        LeaseError,
        NotPermittedError,
        StoppedError,
        CancelledError,
        TeleopBusyError,
        TeleopNotReady,
    )
}


def from_error_object(
    error: Any,
    method: str | None = None,
    voice: Voice | None = None,
    daemon_version: str | None = None,
) -> LiteGripError:
    """Return the exception for the error object of an answer to `method`.

    Its message and hint are put into the words of a `voice`, that of Python unless given.

    A reason that this version does not know, from a newer daemon, becomes the exception of its
    code, and `LiteGripError` when the code is unknown as well. What an older daemon lacks becomes
    a `CommandError` that says so, with `daemon_version`: it is no mistake of the caller's.
    """
    if not isinstance(error, dict):
        return ProtocolError(f"the daemon sent an error that is no object: {error!r:.80}")
    from litegrip_client.values.terms import methods_in, told  # noqa: PLC0415 - only errors need it
    from litegrip_client.values.voices import in_python  # noqa: PLC0415 - only errors need it

    data = error.get("data")
    data = dict(data) if isinstance(data, dict) else {}
    texts = {**data, "message": error.get("message", "the daemon gave no message")}
    voice = voice or in_python
    terms = data.pop("terms", None)
    for name in terms if isinstance(terms, dict) else ():
        if isinstance(data.get(name), str):
            data[name] = told(texts, name, voice, method)
    reason, code = data.get("reason"), error.get("code")
    meant = ""
    if method is not None and reason in ("unknown_method", "invalid_params"):
        lacking = _lacking(method, str(reason), str(texts["message"]), voice)
        if lacking is not None:
            return _older_daemon(lacking, daemon_version, code, data)
        meant = _meant(method, str(texts["message"]))
    row = REASONS.get(reason) if isinstance(reason, str) else None
    if row is None and isinstance(code, int):
        row = REASONS.get(CODES.get(code, ""))
    kind = _CLASSES.get(row[0], LiteGripError) if row is not None else LiteGripError
    made = kind(
        told(texts, "message", voice, method) + meant,
        reason=reason if isinstance(reason, str) else None,
        code=code if isinstance(code, int) else None,
        data=data,
    )
    made.named, made.remedy = (methods_in(texts, name) for name in ("message", "hint"))
    return made


_NO_PARAMETER = r"\S+ has no parameter '(\w+)'"
_NO_VALUE = r"\S+: (\w+) is '([^']*)', it must be one of: "
_NO_FIELD = r"(config): there is no field '(\w+)'"
"""How every daemon refuses what it does not know."""


def _lacking(method: str, reason: str, message: str, voice: Voice) -> str | None:
    """Return what this client's version has and the daemon lacks; None if it is a slip."""
    import re  # noqa: PLC0415 - only errors need it, as the next

    from litegrip_client.values.method_table import METHODS  # noqa: PLC0415

    parameters = METHODS.get(method)
    if parameters is None:
        return None
    if reason == "unknown_method":
        return voice(method, None, None) or method
    stopped = re.search(r"; stopped \(\w+\) all the same$", message)
    then = "" if stopped is None else stopped[0]
    found = re.match(_NO_PARAMETER, message)
    value = None
    if found is None:
        found = re.match(_NO_VALUE, message) or re.match(_NO_FIELD, message)
        value = None if found is None else found[2]
    if found is None or found[1] not in parameters:
        return None
    if value is not None and value not in parameters[found[1]]:
        return None
    what = voice(method, found[1], None) or f"{method} with {found[1]}"
    return what + ("" if value is None else f", {value}") + then


def _meant(method: str, message: str) -> str:
    """Return which of a parameter's values was meant, as an addition to the daemon's refusal.

    The daemon leaves that to its clients: it looks for nothing in the time of its control loop.
    """
    import re  # noqa: PLC0415 - only errors need it, as the next

    from litegrip_client.values.method_table import METHODS  # noqa: PLC0415
    from litegrip_client.values.voices import did_you_mean  # noqa: PLC0415

    found = re.match(_NO_VALUE, message)
    if found is None:
        return ""
    return did_you_mean(found[2], METHODS.get(method, {}).get(found[1], ()))


def _older_daemon(
    lacking: str, daemon_version: str | None, code: Any, data: dict[str, Any]
) -> CommandError:
    from litegrip_client.values.version import client_version  # noqa: PLC0415 - only here

    own = client_version()
    daemon = "" if daemon_version is None else f", litegripd {daemon_version},"
    client = "" if daemon_version == own else f", {own},"  # it runs what was there when it began
    return CommandError(
        f"the daemon{daemon} is older than this client{client} and lacks: {lacking}",
        reason="older_daemon",
        code=code if isinstance(code, int) else None,
        data={
            **data,
            "reason": "older_daemon",
            "hint": "upgrade it as docs/installation.md says, then: litegripctl restart --hold",
        },
    )


def exit_code(error: LiteGripError) -> int:
    """Return the exit code of `litegripctl` for an error: by reason, else by its class."""
    row = REASONS.get(error.reason or "")
    if row is not None:
        return row[1]
    name = type(error).__name__
    return next((code for kind, code in REASONS.values() if kind == name), INTERNAL_EXIT_CODE)
