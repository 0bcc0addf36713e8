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
"""What the jaws do when the client that they belonged to is lost: keep the present hold, go
slack (zero torque), or disable the motor."""

StopLevel: TypeAlias = Literal["hold", "relax", "disable"]
STOP_LEVELS: tuple[StopLevel, ...] = ("hold", "relax", "disable")
"""From the mildest to the strictest; a latched stop can only be raised."""


@dataclass(frozen=True, slots=True)
class Owner:
    """Who asked for something: the connection's number, and the process as the kernel knows it.

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
    """One motion; ends with a `result`, or with an `error` when it could not run its course.

    `grant` is the number of the lease under which it runs, None where the lease was free; `key`
    is the caller's own name for it.
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
        """True if it has not ended; one that waits for its turn has not."""
        return self.state in (JobState.RUNNING, JobState.QUEUED)


@dataclass(frozen=True, slots=True)
class TaskResult:
    """What became of a task: `value` where it worked, else `error`, a sentence.

    `reason` is that of the error table, where it is not for the one who asked to find it.
    """

    value: object = None
    error: str | None = None
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class HelperTask:
    """One operation of the helper process; `on_result` is called once, between two ticks.

    `uid` is the user whose request it is alone; None for the daemon's own, and for what a motion
    needs, which never wait behind requests.
    """

    operation: str
    parameters: Mapping[str, object]
    on_result: Callable[[TaskResult], None]
    uid: int | None = None
