"""The forms of states, jobs, results and the daemon's facts on the wire, and who waits for them.

What is the same for many, for example the state of a tick, is encoded once and spliced in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, NewType, Protocol, TypeAlias, TypedDict

from litegripd.control.controller import Controller
from litegripd.control.events import KEPT_JOBS
from litegripd.control.snapshot import GripperState, JobSummary, snapshot
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Mount
from litegripd.model.motor import BusState
from litegripd.model.sentence import TermViews, with_terms
from litegripd.model.state import (
    EventKind,
    Job,
    JobKind,
    Result,
)
from litegripd.model.teleop import LinkState, ReachState
from litegripd.rpc.jsonrpc import (
    ErrorObject,
    RequestId,
    encode,
    error_line,
    error_object,
    notification_line,
    result_line,
)
from litegripd.rpc.sessions import Role, Session

Verdict: TypeAlias = Literal["ok", "degraded", "down"]


class MotorFacts(TypedDict):
    """The motor, as configured, and what it said of itself."""

    type: str
    can_id: int
    master_id: int | None
    serial: float | None


class GripperFacts(TypedDict):
    """The calibration in use, and the gains of a hold.

    `stroke_mm` is how far the jaws open by the configuration; `work_stroke_mm` the opening to which
    motion.open goes, null for the open stop; `nm_to_n` the force per torque, N per N·m.
    """

    calibrated: bool
    mount: Mount | None
    travel_mm: float | None
    closed_rad: float | None
    open_rad: float | None
    rad_to_mm: float | None
    nm_to_n: float | None
    stroke_mm: float
    work_stroke_mm: float | None
    kp: float
    kd: float


class Limits(TypedDict):
    """What the daemon takes at most; `rate_hz` is its control rate."""

    rate_hz: float
    max_line_bytes: int
    max_connections: int
    max_connections_per_uid: int


class Protection(TypedDict):
    """How the way to another machine is protected.

    `insecure`: nothing is encrypted, and everybody may do everything. `certificate_expires_s` is
    when the portal's certificate is over, in Unix time; null without one.
    """

    insecure: bool
    certificate_expires_s: float | None


class Remote(Protection):
    """By which way a client of another machine comes; `channel` is the gripper's name there.

    `user` and `role` are those that the gateway acts with for it; `portal` and `gateway` are the
    versions of both, `router` where the portal meets the router.
    """

    site: str
    gripper: str
    channel: str
    user: str
    role: Role
    portal: str
    gateway: str
    router: list[str]


class Hello(TypedDict):
    """The daemon, the motor and the limits; `remote` is null, except through a portal."""

    daemon: str
    version: str
    protocol: int
    channel: str
    pid: int
    epoch: str
    simulated: bool
    stop_socket: str | None
    remote: Remote | None
    motor: MotorFacts
    gripper: GripperFacts
    limits: Limits


class CalibrationFacts(TypedDict):
    """Where the calibration came from; `saved_s` is the file's date, in Unix time.

    `foreign` says why it is probably another gripper's, None if it bears no such mark;
    `work_stroke` that its work stroke is beyond the travel; `problem` why a file that is there is
    not used.
    """

    file: str | None
    nominal: bool
    channel: str | None
    saved_s: float | None
    foreign: str | None
    work_stroke: str | None
    problem: str | None


class BusFacts(TypedDict):
    """The bus, as configured."""

    interface: str
    channel: str
    bitrate: int


class RpcFacts(TypedDict):
    """The socket, as configured."""

    group: str


class TrajectoryLimits(TypedDict):
    """How many named trajectories each user may have."""

    most_per_user: int
    most_mb_per_user: int


class StrokeFacts(TypedDict):
    """The stroke, as configured, and the calibration file that is named, None for none."""

    stroke_mm: float
    calibration: str | None


class Configuration(TypedDict):
    """What the daemon's configuration file says, or would."""

    file: str | None
    bus: BusFacts
    control: Mapping[str, object]
    gripper: StrokeFacts
    rpc: RpcFacts
    trajectories: TrajectoryLimits


MotionFields = NewType("MotionFields", dict[str, float])
"""The wire form of a `MotionConfig`."""


class Info(Hello):
    """What does not change."""

    registers: Mapping[str, float | None]
    motor_warnings: list[str]
    calibration_file: str | None
    calibration: CalibrationFacts
    motion: MotionFields
    configuration: Configuration


class Durations(TypedDict):
    """How long something took: percentiles and the worst; null before the first."""

    p50_us: float | None
    p99_us: float | None
    p99_9_us: float | None
    worst_us: float | None


class ControlFigures(TypedDict):
    """The figures of the control loop."""

    rate_hz: float
    ticks: int
    lost_ticks: int
    tick_errors: int
    lateness: Durations
    tick_cost: Durations
    cpu_share: float
    fifo_priority: int
    memory_locked: bool
    cpus: tuple[int, ...]
    longest_collection_us: float
    resident_mb: float


class BusFigures(TypedDict):
    """The figures of the bus.

    `bitrate` (bit/s) is the network interface's, null where it has none or it is not known, and
    `ifindex` the kernel's number of it, which stays when it is renamed.
    `pump_late_us`: the longest that a frame has lately waited for the process that drives the
    adapter while the adapter was free; null for an adapter without such a process.
    """

    state: BusState
    error: str | None
    bitrate: int | None
    ifindex: int | None
    load: float
    sent: int
    received: int
    send_failures: int
    ignored: int
    error_frames: int
    errors: int
    reopened: int
    pump_late_us: float | None


MotorFigures = NewType("MotorFigures", dict[str, object])
"""The motor's counters, and `MotorUse`."""


class MotorUse(TypedDict):
    """Who uses the motor.

    `foreign_active` is true if somebody else commands it just now. `in_use` is true while it may be
    enabled, while somebody has the lease or a motion, and after a request that failed for it; else
    nobody misses a motor that does not answer.
    """

    foreign_active: bool
    in_use: bool


class HeatFigures(TypedDict):
    """The coil's temperature as the model has it; `allowed_nm` is null without a limit."""

    coil_c: float | None
    limit_c: float
    time_to_limit_s: float | None
    allowed_nm: float | None


class RpcFigures(TypedDict):
    """What the clients ask for."""

    clients: int
    requests: int
    refused_requests: int
    refused_connections: int
    budget_exhausted: int
    late_shares: int


class SpawnerFigures(TypedDict):
    """The process that starts the others."""

    pid: int | None
    is_running: bool
    deaths: int


class HelperFigures(TypedDict):
    """The process that reads and writes files."""

    pid: int | None
    deaths: int
    refused: int
    waiting: int


class LinkFigures(TypedDict):
    """The process of the teleoperation's link.

    `reach` is how far a slave has come to its leader, or a master over UDP to its followers, and
    `unreached` what is in the way, and for how long.
    """

    pid: int | None
    is_running: bool
    deaths: int
    link: LinkState | None
    open_to_network: bool | None
    reach: ReachState | None
    unreached: str | None


class LogFigures(TypedDict):
    """The figures of the log."""

    dropped: int
    is_stuck: bool


class Figures(TypedDict):
    """The daemon's figures by their rooms."""

    uptime_s: float
    control: ControlFigures
    bus: BusFigures
    motor: MotorFigures
    heat: HeatFigures
    rpc: RpcFigures
    spawner: SpawnerFigures
    helper: HelperFigures
    teleop: LinkFigures
    log: LogFigures


class Judged(TypedDict):
    """The verdict on the daemon and its reasons; `remote` is null, except through a portal.

    `notes` name what is normal, and worth knowing, for example that nobody uses a motor whose power
    is off.
    """

    verdict: Verdict
    reasons: list[str]
    notes: list[str]
    remote: Protection | None


class Facts(Protocol):
    """The daemon's own facts, as JSON can hold them."""

    def hello(self) -> Mapping[str, object]:
        """Return what `Hello` declares."""

    def health(self, now_s: float) -> Mapping[str, object]:
        """Return what `Judged` and `Figures` declare; no figures before the daemon has started."""

    def info(self) -> Mapping[str, object]:
        """Return what `Info` declares."""


# Forms --------------------------------------------------------------------------------------------

_STATE_FIELDS = tuple(field.name for field in fields(GripperState))

StateView = NewType("StateView", dict[str, Any])
"""The wire form of a `GripperState`, or of some of its fields."""


class JobNumber(TypedDict):
    """The number of a job."""

    job: int


class EndState(TypedDict):
    """The state in which a job ended."""

    state: StateView


class Program(TypedDict):
    """A process."""

    program: str
    pid: int


class OwnerView(Program):
    """Who asked for something: the number of a connection, and the process at its other end."""

    client: int
    uid: int


class JobSummaryView(JobNumber):
    """The running job, in brief."""

    kind: str
    phase: str | None
    owner: Program


class JobHead(JobNumber):
    """A job, but for its result; `state` is the value of a `JobState`."""

    kind: JobKind
    state: str
    owner: OwnerView
    detached: bool
    started_s: float
    ended_s: float | None
    phase: str | None
    error: ErrorObject | None


class JobEnd(TypedDict):
    """The result of a job."""

    result: Result | None


class _NumberedEvent(TypedDict):
    seq: int
    monotonic_s: float
    kind: EventKind
    message: str
    data: Mapping[str, object]


class NumberedEvent(_NumberedEvent, total=False):
    """An event; `data` is other for each kind, and `terms` are those of the message."""

    terms: TermViews


class ProgressHead(JobNumber):
    """Whose progress it is: the job's, and the id of the request that wants it."""

    request: str | int
    kind: JobKind


class ProgressEnd(TypedDict):
    """Where the jaws are, where that is known."""

    opening_mm: float | None


def _plain(value: Any) -> dict[str, Any]:
    """Return a dict of a flat dataclass, field by field; `dataclasses.asdict` copies deeply."""
    return {field.name: getattr(value, field.name) for field in fields(value)}


def state_view(state: GripperState, names: tuple[str, ...] = ()) -> StateView:
    """Return a state's wire form, or only these fields of it, in this order."""
    view: dict[str, Any] = {name: getattr(state, name) for name in names or _STATE_FIELDS}
    job: JobSummary | None = view.get("job")
    if job is not None:
        owner: Program = {"program": job.program, "pid": job.pid}
        summary: JobSummaryView = {
            "job": job.job,
            "kind": job.kind,
            "phase": job.phase,
            "owner": owner,
        }
        view["job"] = summary
    if view.get("stop") is not None:
        view["stop"] = _plain(view["stop"])
    return StateView(view)


def encode_job(job: Job, phase: str | None, result: bytes | None) -> bytes:
    """Encode a job, with its encoded result, if it has one."""
    owner = job.owner
    view: JobHead = {
        "job": job.number,
        "kind": job.kind,
        "state": job.state.value,
        "owner": {
            "client": owner.client,
            "pid": owner.pid,
            "uid": owner.uid,
            "program": owner.program,
        },
        "detached": job.detached,
        "started_s": job.started_s,
        "ended_s": job.ended_s,
        "phase": phase,
        "error": None if job.error is None else error_object(job.error),
    }
    return _with(encode(view), b"result", b"null" if result is None else result)


def _with(encoded: bytes, name: bytes, value: bytes) -> bytes:
    """Add a member, already JSON, to an encoded object that has others."""
    return b'%b,"%b":%b}' % (encoded[:-1], name, value)


# Once per tick ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _End:
    """A job that has ended, and its result, as JSON: 64 of them are listed in one answer."""

    job: bytes
    result: bytes | None


class Reporter:
    """One encoding of the state per tick serves all clients.

    A request may change the state between two ticks: `refresh` is called after each such request.
    """

    def __init__(self, controller: Controller, period_s: float) -> None:
        self._controller = controller
        self._period_s = period_s
        self._now_s = 0.0
        self._state: GripperState | None = None
        self._line: bytes | None = None
        self._ends: dict[int, _End] = {}

    @property
    def rate_hz(self) -> float:
        """How often the state is new."""
        return round(1.0 / self._period_s, 6)

    def tick(self, now_s: float) -> None:
        """Begin a new period."""
        self._now_s = now_s
        self.refresh()

    def refresh(self) -> None:
        """Compute the state again when it is next needed."""
        self._state = None
        self._line = None

    def state(self) -> GripperState:
        """Return the present state."""
        if self._state is None:
            self._state = snapshot(self._controller, self._now_s, self._period_s)
        return self._state

    def state_view(self) -> StateView:
        """Return the present state in its wire form."""
        return state_view(self.state())

    def state_line(self) -> bytes:
        """Return the present state as JSON."""
        if self._line is None:
            self._line = encode(self.state_view())
        return self._line

    def job(self, job: Job) -> bytes:
        """Return a job as JSON; an ended job has the state in which it ended."""
        if job.is_running:
            progress = self._controller.progress() if job is self._controller.jobs.running else None
            return encode_job(job, None if progress is None else progress.phase, None)
        return self._end_of(job).job

    def result(self, job: Job) -> bytes | None:
        """Return the result of a job that ended with one, as JSON."""
        return self._end_of(job).result

    def keep_ends(self) -> None:
        """Encode every job that has ended in this period, and forget those no longer kept."""
        for job in self._controller.jobs.take_ended():
            self._end_of(job)
        if len(self._ends) > 2 * KEPT_JOBS:
            kept = {job.number for job in self._controller.jobs}
            self._ends = {number: end for number, end in self._ends.items() if number in kept}

    def memory(self) -> dict[str, list[str | None]]:
        """Return what is kept of the ended jobs, in a form for JSON."""
        return {
            str(number): [end.job.decode(), None if end.result is None else end.result.decode()]
            for number, end in self._ends.items()
        }

    def restore(self, plain: Mapping[str, Sequence[str | None]]) -> None:
        """Restore what `memory` has returned in a predecessor."""
        for number, (job, result) in plain.items():
            encoded = None if result is None else result.encode()
            self._ends[int(number)] = _End((job or "").encode(), encoded)

    def _end_of(self, job: Job) -> _End:
        end = self._ends.get(job.number)
        if end is None:
            result: bytes | None = None
            if job.result is not None:  # with the state in which the job ended
                encoded = encode(with_terms({"job": job.number, **_plain(job.result)}))
                result = _with(encoded, b"state", self.state_line())
            end = self._ends[job.number] = _End(encode_job(job, None, result), result)
        return end


# Waiting requests

MAX_PER_SESSION = 32
PROGRESS_INTERVAL_S = 0.05  # 20 Hz


@dataclass(frozen=True, slots=True)
class Waiter:
    """One unanswered request: for the job's result, or for the job itself (`job.wait`)."""

    session: Session
    request: RequestId
    job: Job
    wants_job: bool
    wants_progress: bool


class Waiters:
    """The unanswered requests by the number of their job, and their answers.

    A defect in one answer does not affect the others.
    """

    def __init__(self, controller: Controller, reporter: Reporter) -> None:
        self._controller = controller
        self._reporter = reporter
        self._waiters: dict[int, list[Waiter]] = {}
        self._next_progress_s = 0.0

    def add(self, waiter: Waiter) -> None:
        """Let a request wait."""
        waiter.session.unanswered += 1
        self._waiters.setdefault(waiter.job.number, []).append(waiter)

    def remove_all(self, session: Session) -> None:
        """Forget the requests of a client that is gone."""
        for job, waiters in list(self._waiters.items()):
            kept = [waiter for waiter in waiters if waiter.session is not session]
            if kept:
                self._waiters[job] = kept
            else:
                del self._waiters[job]

    def answer(self) -> None:
        """Answer the requests whose job has ended."""
        for number, waiters in list(self._waiters.items()):
            if waiters[0].job.is_running:
                continue
            del self._waiters[number]
            for waiter in waiters:
                waiter.session.unanswered -= 1
                try:
                    line = self._final_line(waiter)
                except Exception as error:  # noqa: BLE001 - the other waiters get their answers
                    line = error_line(waiter.request, defect(waiter.job.kind, error))
                waiter.session.write(line)

    def send_progress(self, now_s: float) -> None:
        """Send the running job's position to the clients that want it, when that is due.

        A client that has not read the last report gets none.
        """
        job = self._controller.jobs.running
        if job is None or job.number not in self._waiters or now_s < self._next_progress_s:
            return
        progress = self._controller.progress()
        if progress is None:
            return
        self._next_progress_s = now_s + PROGRESS_INTERVAL_S
        for waiter in self._waiters[job.number]:
            if waiter.wants_progress and not waiter.session.congested:
                view = {
                    "job": job.number,
                    "request": waiter.request,
                    "kind": job.kind,
                    **_plain(progress),
                    "opening_mm": self._reporter.state().opening_mm,
                }
                waiter.session.write(notification_line("job.progress", encode(view)))

    def _final_line(self, waiter: Waiter) -> bytes:
        job = waiter.job
        if waiter.wants_job:
            return result_line(waiter.request, self._reporter.job(job))
        result = self._reporter.result(job)
        if result is None:
            ended = job.error or Refusal("internal_error", f"job {job.number} ended without result")
            return error_line(waiter.request, ended)
        return result_line(waiter.request, result)


def defect(what: str, error: Exception) -> Refusal:
    """Return the client's message for a defect."""
    return Refusal("internal_error", f"{what} failed by a defect: {type(error).__name__}: {error}")
