"""The gripper's jobs, its state in one tick and the events in it, as every client sees them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.geometry import Mount
from litegripd.model.motor import BusState
from litegripd.model.results import Result

JobKind: TypeAlias = Literal[
    "enable",
    "disable",
    "clear_fault",
    "open",
    "close",
    "grasp",
    "move",
    "hold",
    "set_force",
    "zero_gravity",
    "stream",
    "zero",
    "calibrate_by_hand",
    "set_zero",
    "teleop",
    "record",
    "play",
]
OnLost: TypeAlias = Literal["hold", "relax", "disable"]
"""What the jaws do when the client that had them is lost: keep the present hold, go slack (zero
torque), or disable the motor."""

StopLevel: TypeAlias = Literal["hold", "relax", "disable"]
STOP_LEVELS: tuple[StopLevel, ...] = ("hold", "relax", "disable")
"""From the mildest to the strictest. A latched stop can only be raised."""


@dataclass(frozen=True, slots=True)
class Owner:
    """Who sent a request: the connection's number, and the process as the kernel knows it.

    `grant` is the number of the lease whose token came with the request, None without one.
    """

    client: int
    pid: int
    uid: int
    program: str
    grant: int | None = None


class JobState(Enum):
    """How far a job is."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Stop:
    """A latched stop."""

    level: StopLevel
    by: Owner | None
    since_s: float
    why: str | None


@dataclass(slots=True)
class Job:
    """One motion; it ends with a `result`, or with an `error` if it could not be completed.

    `grant` is the number of the lease under which it runs, None if the lease was free; `key` is the
    caller's own name for it.
    """

    number: int
    kind: JobKind
    owner: Owner
    detached: bool
    started_s: float
    state: JobState = JobState.RUNNING
    ended_s: float | None = None
    result: Result | None = None
    error: Refusal | None = None
    grant: int | None = None
    key: str | None = None

    @property
    def is_running(self) -> bool:
        """True if it has not ended, also while it waits for its turn."""
        return self.state in (JobState.RUNNING, JobState.QUEUED)


@dataclass(frozen=True, slots=True)
class TaskResult:
    """How a task ended: with a `value`, or with an `error`, a sentence.

    `reason` is a reason of the error table; None if the code that asked decides.
    """

    value: object = None
    error: str | None = None
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class HelperTask:
    """One operation of the helper process; `on_result` is called once, between two ticks.

    `uid` is the user who alone asked for it. It is None for the daemon's own tasks and for those of
    a motion, which never wait behind requests.
    """

    operation: str
    parameters: Mapping[str, object]
    on_result: Callable[[TaskResult], None]
    uid: int | None = None


Mode: TypeAlias = Literal[
    "offline", "disabled", "enabling", "holding", "moving", "relaxed", "disabling", "fault"
]


@dataclass(frozen=True, slots=True)
class JobSummary:
    """The running job, in brief; the client of its owner as `program` and `pid`."""

    job: int
    kind: str
    phase: str | None
    program: str
    pid: int


@dataclass(frozen=True, slots=True)
class StopSummary:
    """The latched stop, in brief; `by` names the program, None for the daemon itself.

    `repeats` counts the stops since then that did not raise the level; they make no events.
    """

    level: str
    by: str | None
    since_s: float
    why: str | None
    repeats: int


@dataclass(frozen=True, slots=True)
class GripperState:
    """All that is known in the tick `seq`; None for what is unknown.

    Times are of CLOCK_MONOTONIC, which all processes of a machine share. `feedback_s` is when the
    motor was asked for the measurement, `age_s` its age at `monotonic_s`; `stale` marks a
    measurement that is older than it should be, or of a motor that does not answer. `enabled` is
    None while nothing is known, and while the last report of a motor that is silent, or is being
    enabled or disabled, was that it is enabled. `requested_rad` and `requested_torque_nm` are what
    the running motion or hold wanted in this tick, `command_rad` and `command_torque_nm` what the
    motor got, and `limited` names the limits that make the difference. `force_set_n` is the set
    force of a hold by force, None without one and when the motor is off; `is_grasped` is true if
    such a hold has something between the jaws. Then `clamp_n` is the interval of the force on the
    object (friction hides the exact value; the lower end is 0 while the jaws follow an object that
    gave way), `loss_detection` is true if the loss of the object would be noticed, and
    `loss_detection_from_n` is the smallest set force with which it would.
    """

    seq: int
    monotonic_s: float
    feedback_s: float | None
    age_s: float | None
    stale: bool
    bus: BusState
    motor: str
    error_code: int | None
    status: str | None
    enabled: bool | None
    mode: Mode
    position_rad: float | None
    velocity_rad_s: float | None
    torque_nm: float | None
    force_n: float | None
    opening_mm: float | None
    openness: float | None
    driver_temperature_c: int | None
    coil_temperature_c: int | None
    command_rad: float | None
    command_torque_nm: float | None
    requested_rad: float | None
    requested_torque_nm: float | None
    limited: tuple[str, ...]
    force_set_n: float | None
    is_grasped: bool
    clamp_n: tuple[float, float] | None
    loss_detection: bool | None
    loss_detection_from_n: float | None
    calibrated: bool
    mount: Mount | None
    job: JobSummary | None
    stop: StopSummary | None
    stop_generation: int


EventKind: TypeAlias = Literal[
    "job_started",
    "job_ended",
    "stop",
    "stop_cleared",
    "bus",
    "motor",
    "second_master",
    "implausible",
    "client_lost",
    "object_lost",
    "object_moved",
    "heat",
    "calibration",
    "lease",
    "lease_lost",
    "recorder",
    "refused",
    "teleop",
]


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened: a sentence for a person, and the same for a program."""

    kind: EventKind
    message: str
    data: Mapping[str, object] = field(default_factory=dict)
