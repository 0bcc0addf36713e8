"""The gripper's jobs and how they end, and its events, as every client sees them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal, TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.teleop import TeleopMode

MoveOutcome: TypeAlias = Literal[
    "pressed_home", "reached", "blocked", "protected", "no_stop", "timed_out"
]
"""`pressed_home`: stalled on the mechanical stop. `reached`: arrived at the position asked for.
`blocked`: stalled short of it. `protected`: let go of what took too much torque on the way.
`no_stop`: the jaws passed the calibrated stop and met none. `timed_out`: neither stalled nor
arrived."""

GraspOutcome: TypeAlias = Literal[
    "object_held", "wrong_width", "motor_weak", "no_object", "object_lost", "timed_out"
]
"""`object_held`: something is held. `wrong_width`: something is held, but not of the width asked
for. `motor_weak`: the jaws stand, but the motor makes less torque than is commanded: what is
between them is held by less than was asked for. `no_object`: the jaws came to the empty end.
`object_lost`: they closed further after a grip. `timed_out`: they neither gripped nor arrived."""

ZeroOutcome: TypeAlias = Literal[
    "measured", "implausible_travel", "not_found", "not_confirmed", "not_saved"
]
"""`measured`: both stops were found, and the calibration is in use. With the others nothing has
changed. `implausible_travel`: far from the travel known before. `not_found`: a stop was not met.
`not_confirmed`: strokes with the speed of a `close` do not end at it, or no `close` would press
there. `not_saved`: the file could not be written."""


RecordOutcome: TypeAlias = Literal["stopped", "full", "failed"]
"""`stopped`: ended by request. `full`: as long as it could or should be. `failed`: ended early."""

ReplayOutcome: TypeAlias = Literal[
    "completed", "blocked", "not_aligned", "motor_weak", "no_object", "object_lost", "timed_out"
]
"""`completed`: the jaws followed the path to its end. `blocked`: the path ended, but the jaws
did not get there. `not_aligned`: they did not get to its start. For a repeated grip the outcomes
of a grasp: `motor_weak`, `no_object`, `object_lost`, `timed_out`."""


@dataclass(frozen=True, slots=True)
class MoveResult:
    """How `open`, `close` or a move to a position ended.

    A success of `open` and `close` is `ok`, `stalled` and not `reached`: the target lies past the
    stop on purpose.
    """

    ok: bool
    outcome: MoveOutcome
    reached: bool
    stalled: bool
    protected: bool
    target_rad: float
    limit_rad: float
    final_command_rad: float
    steps: int


@dataclass(frozen=True, slots=True)
class EnableResult:
    """The result of enabling: confirmed or not, after how many tries, and if not, why."""

    ok: bool
    tries: int
    reason: str | None = None
    message: str | None = None


@dataclass(frozen=True, slots=True)
class DisableResult:
    """The result of disabling: confirmed by the motor or not."""

    ok: bool


@dataclass(frozen=True, slots=True)
class ClearFaultResult:
    """The motor has no fault; `cleared` names the one that it had, None without one."""

    ok: bool
    cleared: str | None


@dataclass(frozen=True, slots=True)
class HoldResult:
    """The position at which the jaws are held from now on."""

    position_rad: float


@dataclass(frozen=True, slots=True)
class GraspResult:
    """How a grasp ended; at its verdict, how it began.

    `force_n` is the set force; `cycles` counts the full `hold_interval`s of the hold; `width_mm` is
    the opening at the verdict, None if nothing was met. `speed_mm_s` is how fast the jaws closed:
    as requested, or slower for a small force; None if they held the object already.
    """

    ok: bool
    outcome: GraspOutcome
    reached: bool
    stalled: bool
    target_rad: float
    force_n: float
    cycles: int
    width_mm: float | None
    held_s: float
    speed_mm_s: float | None = None


@dataclass(frozen=True, slots=True)
class ForceResult:
    """The force with which the jaws squeeze from now on."""

    force_n: float


@dataclass(frozen=True, slots=True)
class SlackResult:
    """Where the jaws were when they went slack."""

    position_rad: float


@dataclass(frozen=True, slots=True)
class StreamResult:
    """The number of set-points of a stream."""

    set_points: int


@dataclass(frozen=True, slots=True)
class ZeroResult:
    """How a calibration ended; `content` is the file's, None if there is no new calibration."""

    ok: bool
    outcome: ZeroOutcome
    closed_rad: float | None
    open_rad: float | None
    travel_rad: float | None
    rad_to_mm: float | None
    content: Mapping[str, Any] | None
    path: str | None
    message: str | None


@dataclass(frozen=True, slots=True)
class SetZeroResult:
    """How the motor's zero was set: every position is now less by `shift_rad` than before.

    `position_rad` is the first position measured from the new zero.
    """

    ok: bool
    shift_rad: float
    position_rad: float


@dataclass(frozen=True, slots=True)
class RecordResult:
    """How a recording by hand ended; `missed` counts samples without a measurement in time."""

    ok: bool
    outcome: RecordOutcome
    samples: int
    missed: int
    message: str | None


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """How a replay ended: after `loops` whole passes and `frames` commands.

    `largest_lag_mm` is the largest distance of the jaws from the path. It includes what they travel
    while a measurement is on its way. Of repeated grips `grips` counts those that held something,
    and `width_mm` is the latest one's. `width_difference_mm` is by how much the most different
    object was wider (above 0) or narrower than the taught one.
    """

    ok: bool
    outcome: ReplayOutcome
    loops: int
    frames: int
    largest_lag_mm: float
    final_command_rad: float
    grips: int = 0
    width_mm: float | None = None
    width_difference_mm: float | None = None


@dataclass(frozen=True, slots=True)
class TeleopResult:
    """How teleoperation ended: the frames that were sent or followed, and what went wrong."""

    ok: bool
    mode: TeleopMode
    frames: int
    rejected: int
    send_failed: int
    torque_trips: int


Result: TypeAlias = (
    MoveResult
    | EnableResult
    | DisableResult
    | ClearFaultResult
    | HoldResult
    | GraspResult
    | ForceResult
    | SlackResult
    | StreamResult
    | ZeroResult
    | SetZeroResult
    | RecordResult
    | ReplayResult
    | TeleopResult
)


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a motion is: its phase, its step of the total, command and feedback."""

    phase: str
    step: int
    total_steps: int
    command_rad: float
    position_rad: float
    torque_nm: float
    coil_temperature_c: int


@dataclass(frozen=True, slots=True)
class ReplayProgress(Progress):
    """Where a replay is; `openness` is the path's present one, `loops` counts whole passes.

    `grips` and `width_mm` are those of `ReplayResult`, so far.
    """

    frames: int
    speed: float
    openness: float
    loops: int
    grips: int
    width_mm: float | None


@dataclass(frozen=True, slots=True)
class Restarted:
    """The successor that has taken over, and the time between the commands of the two."""

    pid: int
    gap_s: float


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
class User:
    """Whose request it is: a user of this machine, or one of others behind a gateway's user."""

    uid: int
    remote: str | None = None

    def __str__(self) -> str:
        return f"uid {self.uid}" if self.remote is None else f"{self.remote}, uid {self.uid}"


@dataclass(frozen=True, slots=True)
class Owner:
    """Who sent a request: the connection's number, and the process as the kernel knows it.

    `grant` is the number of the lease whose token came with the request, None without one. `remote`
    is the user of another machine for whom a gateway sent it, None for everybody else.
    """

    client: int
    pid: int
    uid: int
    program: str
    grant: int | None = None
    remote: str | None = None

    @property
    def user(self) -> User:
        """Whose request it is."""
        return User(self.uid, self.remote)


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
    "released_by_fault",
    "weak",
    "pressing",
    "swing",
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
