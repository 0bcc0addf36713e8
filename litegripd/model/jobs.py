"""Work that takes time: a motion as a job, and a task for the helper process, which has a disk."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal, TypeAlias

from litegripd.model.errors import Refusal
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
