"""Every refusal and failure by a stable reason: the one table for daemon, client and docs.

Inside a tick a refusal is a value, `Refusal`; it becomes an exception only in the client. The
exception names `CommandError` and `HardwareError` are the vendor SDK's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from math import isfinite
from types import MappingProxyType
from typing import TypeAlias

from litegripd.model.sentence import Sentence


def at_most(limit: float, digits: int = 6) -> str:
    """Return an upper limit as it is told, never rounded up: who gives what is told is accepted."""
    return _rounded(limit, digits, ROUND_FLOOR)


def at_least(limit: float, digits: int = 6) -> str:
    """Return a lower limit as it is told, never rounded down."""
    return _rounded(limit, digits, ROUND_CEILING)


_UNITS = (
    *(("_rad_s", "rad/s"), ("_mm_s", "mm/s"), ("_n_s", "N/s"), ("_nm_rad", "N·m/rad")),
    *(("_rad", "rad"), ("kp", "N·m/rad"), ("kd", "N·m·s/rad")),
    *(("_mm", "mm"), ("_nm", "N·m"), ("_n", "N"), ("_s", "s"), ("hz", "Hz"), ("_c", "°C")),
)


def unit_of(name: str) -> str:
    """Return the unit that a name ends with, as it stands behind a number; "" without one."""
    return next((f" {unit}" for end, unit in _UNITS if name.endswith(end)), "")


def as_typed(value: object) -> str:
    """Return a value as a person has typed it: clients send 50 as 50.0."""
    return repr(value).removesuffix(".0") if isinstance(value, float) else repr(value)


def _rounded(limit: float, digits: int, how: str) -> str:
    if not isfinite(limit):
        return f"{limit:g}"
    return f"{float(Context(digits, how).create_decimal(Decimal(limit))):.{digits}g}"


ErrorData: TypeAlias = Mapping[str, Sentence | object]
_NO_DATA: ErrorData = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class ErrorKind:
    """One row of the error table.

    `code` is the JSON-RPC error code; `exception` the client's exception; `exit_code` that of
    `litegripctl`; `retryable` is True if the same request may succeed later unchanged.
    """

    reason: str
    code: int
    exception: str
    exit_code: int
    retryable: bool
    meaning: str


ERROR_TABLE: tuple[ErrorKind, ...] = (
    ErrorKind("parse_error", -32700, "ProtocolError", 70, False, "The line is not valid JSON."),
    ErrorKind(
        "invalid_request", -32600, "ProtocolError", 70, False, "The JSON is not a request object."
    ),
    ErrorKind("unknown_method", -32601, "ProtocolError", 70, False, "No method of that name."),
    ErrorKind(
        "invalid_params",
        -32602,
        "ParameterError",
        4,
        False,
        "A parameter is unknown, missing, of the wrong type or out of its range.",
    ),
    ErrorKind(
        "internal_error", -32603, "LiteGripError", 70, False, "A defect of the daemon; see its log."
    ),
    ErrorKind(
        "line_too_long",
        -32000,
        "ProtocolError",
        70,
        False,
        "A line over 16 KiB; the connection is closed.",
    ),
    ErrorKind(
        "too_many_connections",
        -32001,
        "ConnectError",
        3,
        True,
        "No further connection is let in, in all or for this user.",
    ),
    ErrorKind(
        "too_many_requests",
        -32002,
        "BusyError",
        6,
        True,
        "This connection has too many unanswered requests or subscriptions.",
    ),
    ErrorKind(
        "backlog_full",
        -32003,
        "ConnectError",
        3,
        True,
        "The client does not read its answers; the connection is closed.",
    ),
    ErrorKind("shutting_down", -32004, "ConnectError", 3, True, "The daemon is about to end."),
    ErrorKind(
        "starting",
        -32006,
        "BusyError",
        6,
        True,
        "The daemon has just started and is still reading the calibration.",
    ),
    ErrorKind(
        "helper_busy",
        -32007,
        "BusyError",
        6,
        True,
        "The process that reads and writes files has too much to do for this user, or is being"
        " started again.",
    ),
    ErrorKind(
        "restart_failed",
        -32005,
        "CommandError",
        4,
        False,
        "No successor could take over; the daemon continues unchanged.",
    ),
    ErrorKind(
        "not_calibrated",
        -32010,
        "CommandError",
        4,
        False,
        "No calibration is loaded, so the closing direction would be a guess.",
    ),
    ErrorKind(
        "out_of_limits",
        -32011,
        "ParameterError",
        4,
        False,
        "A value is possible in itself but not with the other settings.",
    ),
    ErrorKind("unknown_job", -32012, "CommandError", 4, False, "No such job, or no longer kept."),
    ErrorKind(
        "calibration_unreadable",
        -32013,
        "CommandError",
        4,
        False,
        "A calibration or template that was asked for cannot be used.",
    ),
    ErrorKind(
        "not_saved",
        -32014,
        "CommandError",
        4,
        True,
        "A file of the daemon could not be written; what it held before is kept.",
    ),
    ErrorKind(
        "unknown_trajectory",
        -32015,
        "TrajectoryNotFoundError",
        4,
        False,
        "No trajectory of that name, or a temporary one that has ended.",
    ),
    ErrorKind(
        "trajectory_unreadable",
        -32016,
        "TrajectoryFormatError",
        4,
        False,
        "A trajectory that was asked for, or sent, cannot be used.",
    ),
    ErrorKind(
        "recording_failed",
        -32017,
        "TrajectoryRecordingError",
        4,
        False,
        "No recording came about, or one that was broken off or is empty.",
    ),
    ErrorKind(
        "trajectories_full",
        -32018,
        "CommandError",
        4,
        False,
        "The user has as many named trajectories, or bytes of them, as the daemon's configuration"
        " allows.",
    ),
    ErrorKind("busy", -32020, "BusyError", 6, True, "Another motion is running."),
    ErrorKind(
        "stopped", -32021, "StoppedError", 7, False, "A stop is latched; clear it with stop.clear."
    ),
    ErrorKind(
        "sent_before_stop",
        -32022,
        "StoppedError",
        7,
        False,
        "The request was sent before a stop, so it never runs.",
    ),
    ErrorKind("cancelled", -32023, "CancelledError", 8, False, "The motion was cancelled."),
    ErrorKind(
        "client_lost", -32024, "CancelledError", 8, False, "The client that owned it went away."
    ),
    ErrorKind(
        "replaced",
        -32025,
        "CancelledError",
        8,
        False,
        "Another motion of its owner replaced it.",
    ),
    ErrorKind(
        "lease_held", -32026, "LeaseError", 6, True, "Another client has the gripper to itself."
    ),
    ErrorKind(
        "lease_lost",
        -32027,
        "LeaseError",
        6,
        False,
        "The lease of this token, motion or connection was lost; it does not come back by itself.",
    ),
    ErrorKind(
        "not_permitted",
        -32028,
        "NotPermittedError",
        9,
        False,
        "The user's role, by the daemon's configuration, does not allow it.",
    ),
    ErrorKind(
        "trajectory_busy",
        -32029,
        "TrajectoryBusyError",
        6,
        True,
        "A trajectory is being recorded or replayed.",
    ),
    ErrorKind(
        "set_point_expired",
        -32040,
        "CommandError",
        4,
        False,
        "A set-point was older than it counts for when its turn came.",
    ),
    ErrorKind(
        "teleop_busy",
        -32050,
        "TeleopBusyError",
        6,
        True,
        "Teleoperation is running; end it with teleop.stop.",
    ),
    ErrorKind(
        "teleop_not_ready",
        -32051,
        "TeleopNotReady",
        4,
        False,
        "Teleoperation needs a calibrated gripper whose motor is enabled; what a client brings for"
        " it, one that the same connection has begun.",
    ),
    ErrorKind("not_enabled", -32030, "NotInitializedError", 5, False, "The motor is not enabled."),
    ErrorKind(
        "motor_fault", -32031, "HardwareError", 5, False, "The motor reports a fault by its status."
    ),
    ErrorKind("motor_silent", -32032, "CANTimeoutError", 5, True, "The motor does not answer."),
    ErrorKind("bus_down", -32033, "CommError", 5, True, "The CAN bus cannot be used."),
    ErrorKind(
        "motor_unsuitable",
        -32034,
        "HardwareError",
        5,
        False,
        "A register of the motor does not allow safe use.",
    ),
    ErrorKind(
        "not_confirmed",
        -32035,
        "HardwareError",
        5,
        True,
        "The motor did not confirm the request.",
    ),
    ErrorKind(
        "second_master",
        -32036,
        "HardwareError",
        5,
        True,
        "Another program commands the motor, or writes its registers, on the same bus.",
    ),
    ErrorKind(
        "implausible_feedback",
        -32037,
        "HardwareError",
        5,
        False,
        "The motor's position jumped as no jaw can; motor.clear_fault accepts the new one.",
    ),
    ErrorKind(
        "motor_hot",
        -32038,
        "HardwareError",
        5,
        True,
        "The coil's heat leaves less torque than the motion needs; let the motor cool down.",
    ),
    ErrorKind(
        "unreachable",
        -32060,
        "ConnectError",
        3,
        True,
        "A gripper of another machine does not answer over the network; what was asked last may"
        " have been done.",
    ),
    ErrorKind(
        "too_late",
        -32061,
        "CommandError",
        4,
        True,
        "A request for a gripper of another machine arrived later than it counts for; it was not"
        " carried out.",
    ),
)

ERRORS: Mapping[str, ErrorKind] = MappingProxyType({kind.reason: kind for kind in ERROR_TABLE})


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why something was not done: a reason of the table, a sentence, and what helps.

    The message says what was wrong, what is allowed and what to do; `data` carries the same for
    a program (`owner`, `limit`, `requested`, `hint`).
    """

    reason: str
    message: Sentence | str
    data: ErrorData = field(default_factory=lambda: _NO_DATA)

    def __post_init__(self) -> None:
        """Reject a reason that is not in the table."""
        if self.reason not in ERRORS:
            raise KeyError(f"{self.reason!r} is not in the error table")

    @property
    def kind(self) -> ErrorKind:
        """The table's row for this reason."""
        return ERRORS[self.reason]
