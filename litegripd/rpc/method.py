"""A method: its row, the request that it gets, and the answers that it may give."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias, TypeVar

from litegripd.control.admission import conflict_refusal
from litegripd.control.gains import Gains
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import (
    MotionConfig,
    MotionConfigError,
    damping_conflict,
    ranges_of,
)
from litegripd.model.motor_types import DM4310, MotorType
from litegripd.model.state import Job, Owner
from litegripd.rpc.reports import JobNumber
from litegripd.rpc.schema import Param, Shape
from litegripd.rpc.sessions import Role, Session

# A request and its answers ------------------------------------------------------------------------


class Refused(Exception):  # noqa: N818 - no error: an answer
    """Raised by a method's function, or by its callees, instead of returning a refusal.

    Not by later callbacks, when a helper process has answered.
    """

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.message)
        self.refusal = refusal


T = TypeVar("T")


def accepted(answer: T | Refusal) -> T:
    """Return the answer; raise `Refused` if it is a refusal."""
    if isinstance(answer, Refusal):
        raise Refused(answer)
    return answer


class Call(NamedTuple):
    """One request with checked parameters; `received_s` is when its line came."""

    session: Session
    owner: Owner
    params: Mapping[str, Any]
    now_s: float
    received_s: float

    @property
    def detached(self) -> bool:
        """True if the motion outlives its connection: as requested, else if not waited for."""
        return bool(self.params.get("detach", not self.params.get("wait", True)))

    def gains(self, base: Gains) -> Gains:
        """Return `base` with the stiffness and damping that the caller wants; see `gain_params`."""
        if not ("kp" in self.params or "kd" in self.params):
            return base
        kp = self.params.get("kp", base.kp_nm_rad)
        kd = self.params.get("kd", base.kd_nm_s_rad)
        refusal = conflict_refusal(damping_conflict(kp, kd))
        if refusal is not None:
            raise Refused(refusal)
        return Gains(kp, kd)

    def config(self, base: MotionConfig, period_s: float, motor_type: MotorType) -> MotionConfig:
        """Return `base` with the changes that the caller wants."""
        given = self.params.get("config")
        if given is None:
            return base
        try:
            return base.changed(given, period_s, motor_type)
        except MotionConfigError as error:
            data = {"parameter": "config", "field": error.field}
            raise Refused(Refusal("invalid_params", f"config: {error}", data)) from None


@dataclass(frozen=True, slots=True)
class Later:
    """The answer comes when `job` has ended: its result, or the job itself."""

    job: Job
    wants_job: bool = False


Result: TypeAlias = Mapping[str, Any] | bytes | Refusal


class Deferred:
    """The answer comes with the one call of `resolve`."""

    def __init__(self) -> None:
        self._answer: Result | None = None
        self._on_answer: Callable[[Result], None] | None = None

    def resolve(self, answer: Result) -> None:
        """Give the answer."""
        self._answer = answer
        if self._on_answer is not None:
            self._on_answer(answer)

    def then(self, on_answer: Callable[[Result], None]) -> None:
        """Call `on_answer` with the answer, at once if it has been given already."""
        self._on_answer = on_answer
        if self._answer is not None:
            on_answer(self._answer)


Answer: TypeAlias = Result | Later | Deferred
"""A result now, as a value or as JSON, a refusal, or a later answer."""

Function: TypeAlias = Callable[[Call], Answer]


def later(job: Job | Refusal) -> Answer:
    """Answer when a job has ended, if it has begun."""
    return job if isinstance(job, Refusal) else Later(job)


# Rows ---------------------------------------------------------------------------------------------

COMMON_PARAMS = (
    Param("sent_s", "number", "When the request was sent, seconds of CLOCK_MONOTONIC.", minimum=0),
    Param("stop_generation", "integer", "The count of stops that the sender knew of.", minimum=0),
)
"""Every method takes these; a request from before a stop neither moves nor clears after it."""

LEASE = Param("lease", "string", "The token of the lease under which to do it.")
KEY = Param(
    "key",
    "string",
    "The caller's own name for this motion: sent again by the same process, it answers for the same"
    " job. Two processes may use the same name.",
)
IF_BUSY = Param(
    "if_busy",
    "string",
    "While another motion runs: refuse (reject, the default), end the caller's own one and take its"
    " place (replace), or wait for its end (queue).",
    choices=("reject", "replace", "queue"),
)
AT_ONCE = Shape("AtOnce", (JobNumber,), closed=True)
"""The answer of a method that does not wait for the end of its job."""

WAIT = Param("wait", "boolean", "Answer when it has ended (true, the default), or at once.")
DETACH = Param(
    "detach", "boolean", "Let it outlive this connection (default: what is not waited for)."
)
PROGRESS = Param("progress", "boolean", "Send job.progress on the way (default false).")
JOB = Param("job", "integer", "The job's number.", required=True, minimum=1)
CONFIG = Param(
    "config",
    "object",
    "Fields of the motion configuration (config.get lists them) that count for this call only.",
)
RUN_PARAMS = (CONFIG, WAIT, PROGRESS, DETACH, IF_BUSY, KEY)
"""What every lasting motion takes."""

F = TypeVar("F", bound=Callable[..., Answer])
_ROW = "_method"


@dataclass(frozen=True, slots=True)
class Method:
    """One method; put above its function as a decorator.

    `returns` is the type of the final result: its schema is made from it. `role` is the lowest role
    of a caller; `needs_lease` marks methods that only the holder of the lease may call, while there
    is one; `stop_voids` those that a later stop makes void; `waits` those whose answer comes when a
    job has ended; `may_notify` those that may be sent without an id; `lifts_stop` the one that is
    also for the client that has stopped and for admins, with any role and any holder of the lease.
    """

    name: str
    summary: str
    result: str
    returns: Any
    params: tuple[Param, ...] = ()
    role: Role = "observer"
    needs_lease: bool = False
    stop_voids: bool = False
    waits: bool = False
    may_notify: bool = False
    lifts_stop: bool = False
    declared: Mapping[str, Param] = field(init=False)

    def __post_init__(self) -> None:
        """Index the parameters by name."""
        lease = (LEASE,) if self.needs_lease else ()
        declared = {param.name: param for param in (*self.params, *lease, *COMMON_PARAMS)}
        object.__setattr__(self, "declared", declared)

    def __call__(self, function: F) -> F:
        """Attach this row to the function below it, as a decorator."""
        setattr(function, _ROW, self)
        return function

    def with_motor(self, motor_type: MotorType) -> "Method":
        """Return the row for a type of motor, which has its own limits."""
        return replace(self, params=tuple(param.with_motor(motor_type) for param in self.params))


@dataclass(frozen=True, slots=True)
class Feature:
    """What a slice adds to the service: objects with methods, and calls at a connection's end."""

    groups: tuple[object, ...]
    session_ended: Callable[[Session], None] = lambda _session: None


def methods_of(group: type) -> tuple[Method, ...]:
    """Return the rows above the functions of a class, in their order."""
    return tuple(row for _name, row in _rows(group))


def functions_of(group: object) -> Mapping[str, Function]:
    """Return the functions of an object that have a row, by their methods' names."""
    return {row.name: getattr(group, name) for name, row in _rows(type(group))}


def _rows(group: type) -> Iterator[tuple[str, Method]]:
    for name, member in vars(group).items():
        row = getattr(member, _ROW, None)
        if isinstance(row, Method):
            yield name, row


def speed_param(default: str) -> Param:
    """Return a parameter for a jaw speed whose default is this field of the configuration."""
    text = f"Jaw speed (default: {default} of the configuration)."
    return config_param("speed_mm_s", text)


def config_param(name: str, description: str) -> Param:
    """Return a parameter with the range of the configuration's field of the same name."""
    low, high = ranges_of(DM4310)[name]
    return Param(
        name,
        "number",
        description,
        minimum=low,
        maximum=high,
        maximum_of=lambda motor_type: ranges_of(motor_type)[name][1],
    )


def gain_params() -> tuple[Param, ...]:
    """Return the parameters of a position command's stiffness and damping."""
    kd = "Damping, at least kp · 0.002 s (default: the calibration's)."
    return (
        Param("kp", "number", "Stiffness (default: the calibration's).", minimum=5, maximum=500),
        Param("kd", "number", kd, minimum=0.1, maximum=5),
    )


def target_params() -> tuple[Param, ...]:
    """Return the parameters of a target, in one of three quantities."""
    return (
        Param("opening_mm", "number", "Where to go: the opening, 0 closed."),
        Param("position_rad", "number", "Where to go: the motor's position."),
        Param(
            "openness",
            "number",
            "Where to go: the share of the travel that is open, 0 to 1.",
            minimum=0,
            maximum=1,
        ),
    )
