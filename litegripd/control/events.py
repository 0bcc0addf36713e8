"""The jobs, of which at most one runs, and the controller's events in words.

Jobs that ended are kept for a while, for clients that come back. The words are what the log reports
about motions, stops and power.
"""

import math
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from litegripd.control.authority import Grant, Loss, LossCause, process_of, said_of
from litegripd.control.detectors import Pressing
from litegripd.control.heat import HeatChange, HeatGuard
from litegripd.control.made_torque import MadeTorque
from litegripd.model.calibration import USUAL_RAD_TO_MM, Calibration, work_stroke_warning
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry
from litegripd.model.motor import (
    LATEST_DISARM_S,
    UNANSWERED,
    BusCondition,
    MotorPhase,
    MotorView,
    RegisterReply,
    RegisterRequest,
    remedy,
)
from litegripd.model.plain import Carried
from litegripd.model.sentence import joined, method_name, sentence
from litegripd.model.state import (
    Event,
    GraspResult,
    Job,
    JobKind,
    JobState,
    MoveResult,
    OnLost,
    Owner,
    ReplayResult,
    Result,
    Stop,
)

KEPT_JOBS = 64

MOST_QUEUED = 8

_CANCELLED_BY = frozenset({"cancelled", "client_lost", "lease_lost", "replaced", "stopped"})


@dataclass(frozen=True, slots=True)
class Turn:
    """When a motion that is asked for may begin: without either, only while nothing else runs."""

    replaces: Refusal | None = None
    """The running motion ends for this reason, as soon as this one begins; else it continues."""
    queued: Job | None = None
    """The job whose turn it is now; it does not wait for those queued behind it."""


NOW = Turn()

Start: TypeAlias = Callable[[Turn], Job | Refusal]
"""Asks for a motion again, as its request did; by now it may be rejected."""


@dataclass(frozen=True, slots=True)
class QueuedJob:
    """A job that waits for the end of the running one, and the function that starts it then."""

    job: Job
    start: Start


class JobBook:
    """Numbers the jobs, knows the running and the waiting ones, and keeps the last `KEPT_JOBS`.

    A queued job has a number, too; the controller starts it.
    """

    _last: Carried[int] = 0
    NOT_CARRIED = ("running", "queue", "_jobs", "_ended")  # `_jobs` follows later, by `keep`

    def __init__(self) -> None:
        self.running: Job | None = None
        self.queue: deque[QueuedJob] = deque()
        self._jobs: OrderedDict[int, Job] = OrderedDict()
        self._ended: list[Job] = []

    def __iter__(self) -> Iterator[Job]:
        """Iterate over the kept jobs, the oldest first."""
        return iter(self._jobs.values())

    def get(self, number: int) -> Job | None:
        """Return a kept job, or None."""
        return self._jobs.get(number)

    def latest(self, *kinds: JobKind) -> Job | None:
        """Return the kept job of these kinds that began last."""
        begun = (job for job in self if job.kind in kinds and job.state is not JobState.QUEUED)
        return max(begun, key=lambda job: (job.started_s, job.number), default=None)

    def find(self, owner: Owner, key: str) -> Job | None:
        """Return the kept job to which the same program gave this key."""
        jobs = (job for job in self if job.key == key and _is_same_program(job.owner, owner))
        return next(jobs, None)

    def keep(self, jobs: Iterable[Job]) -> None:
        """Keep ended jobs of a predecessor."""
        self._jobs.update((job.number, job) for job in jobs)

    def add(self, kind: JobKind, owner: Owner, detached: bool, now_s: float) -> Job:
        """Return a new job, which waits for its turn."""
        self._last += 1
        job = Job(self._last, kind, owner, detached, now_s, JobState.QUEUED)
        self._jobs[job.number] = job
        while len(self._jobs) > KEPT_JOBS:
            oldest = next(number for number, kept in self._jobs.items() if not kept.is_running)
            del self._jobs[oldest]
        return job

    def enqueue(
        self, kind: JobKind, owner: Owner, detached: bool, now_s: float, start: Start
    ) -> Job | Refusal:
        """Let a motion wait for its turn, in which `start` is called; at most `MOST_QUEUED` do."""
        if len(self.queue) >= MOST_QUEUED:
            text = f"{MOST_QUEUED} motions wait for their turn already"
            return Refusal("too_many_requests", text, {"limit": MOST_QUEUED})
        job = self.add(kind, owner, detached, now_s)
        self.queue.append(QueuedJob(job, start))
        return job

    def take_queued(self, which: Callable[[Job], bool]) -> list[Job]:
        """Take jobs out of the queue, the oldest first, and return them."""
        taken = [entry.job for entry in self.queue if which(entry.job)]
        self.queue = deque(entry for entry in self.queue if entry.job not in taken)
        return taken

    def begin(self, job: Job, now_s: float) -> None:
        """Make a job the running one; the caller has checked that none is running."""
        job.state, job.started_s = JobState.RUNNING, now_s
        self.running = job

    def end(self, job: Job, outcome: Result | Refusal, now_s: float) -> None:
        """End a job with a result, or with the reason why it could not continue."""
        if job is self.running:
            self.running = None
        job.ended_s = now_s
        self._ended.append(job)
        if isinstance(outcome, Refusal):
            job.error = outcome
            cancelled = outcome.reason in _CANCELLED_BY
            job.state = JobState.CANCELLED if cancelled else JobState.FAILED
        else:
            job.result = outcome
            job.state = JobState.DONE

    def forget_like(self, job: Job) -> None:
        """Forget the job before this one if it was the same: repeats leave room for the others."""
        before = self._jobs.get(job.number - 1)
        if before is None or before.is_running or before.key is not None:
            return
        if (before.kind, before.owner) == (job.kind, job.owner):
            del self._jobs[before.number]

    def take_ended(self) -> list[Job]:
        """Return the jobs that have ended since the last call."""
        ended, self._ended = self._ended, []
        return ended


def _is_same_program(one: Owner, other: Owner) -> bool:
    """Return True if two requests are of one process, perhaps by two connections.

    Processes of another pid namespace have no number here (pid 0), so only their connections
    distinguish them.
    """
    if one.pid == 0 or other.pid == 0:
        return one.client == other.client
    return (one.pid, one.user) == (other.pid, other.user)


MOST_WAITING = 16

OnReply: TypeAlias = Callable[[RegisterReply], None]


@dataclass(frozen=True, slots=True)
class _RegisterRead:
    request: RegisterRequest
    on_reply: OnReply


class RegisterReads:
    """The queue of registers to be read."""

    def __init__(self) -> None:
        self._row: deque[_RegisterRead] = deque()
        self._last = 0

    def add(self, number: int, on_reply: OnReply, sought_id: int | None = None) -> Refusal | None:
        """Add a register to the queue; `on_reply` is called once, in a tick.

        With `sought_id` another id than the motor's own is asked.
        """
        if len(self._row) >= MOST_WAITING:
            text = f"{MOST_WAITING} registers are waiting to be read already: try again"
            return Refusal("too_many_requests", text, {"limit": MOST_WAITING})
        self._last += 1
        self._row.append(_RegisterRead(RegisterRequest(self._last, number, sought_id), on_reply))
        return None

    def step(self, reply: RegisterReply | None) -> RegisterRequest | None:
        """Pass on the motor's latest reply; return the register to ask for now."""
        row = self._row
        if row and reply is not None and reply.identity == row[0].request.identity:
            row.popleft().on_reply(reply)
        return row[0].request if row else None


_ON_LOST_TEXT = {"hold": "keep their hold", "relax": "go slack", "disable": "are disabled"}


def job_started(job: Job) -> Event:
    """Report who began what."""
    owner = job.owner
    text = f"job {job.number}: {job.kind} by {_named(owner)}"
    data = {"job": job.number, "kind": job.kind, "client": owner.client, "pid": owner.pid}
    return Event("job_started", text, {**data, "detached": job.detached})


NO_STOP = sentence(
    ": no stop is where the calibration has one: its limits are too wide, or the motor's zero has"
    " shifted while it was disabled; measure again ({calibration.zero})"
)


def job_ended(job: Job, outcome: Result | Refusal, geometry: Geometry | None) -> list[Event]:
    """Report how a job ended, and the loss of a gripped object; openings if there is a geometry."""
    how = outcome.message if isinstance(outcome, Refusal) else _worded(outcome, geometry)
    is_stopless = isinstance(outcome, MoveResult) and outcome.outcome == "no_stop"
    text = sentence(
        "job {number}: {kind} {state}: {how}{more}",
        number=job.number,
        kind=job.kind,
        state=job.state.value,
        how=how,
        more=NO_STOP if is_stopless else "",
    )
    reason = outcome.reason if isinstance(outcome, Refusal) else None
    data = {"job": job.number, "state": job.state.value, "reason": reason}
    ended = Event("job_ended", text, data)
    lost = isinstance(outcome, GraspResult | ReplayResult) and outcome.outcome == "object_lost"
    return [object_lost(job.number), ended] if lost else [ended]


def object_lost(job: int | None, *, is_doubtful: bool = False) -> Event:
    """Report that the jaws closed further after a grip; that of a weak motor may have been none."""
    what = "there is no object, or it is lost" if is_doubtful else "the object is lost"
    text = f"{what}: the jaws closed on, and hold where they are"
    return Event("object_lost", text, {"job": job})


def object_moved(moved_mm: float, width_mm: float) -> Event:
    """Report that the jaws followed the object, and hold it again."""
    text = f"the object gave way by {moved_mm:.1f} mm and is held again, at {width_mm:.1f} mm"
    return Event("object_moved", text, {"moved_mm": moved_mm, "width_mm": width_mm})


@dataclass(frozen=True, slots=True)
class HeldObject:
    """What was held by force when the motor was last known to be enabled, and when that was."""

    force_n: float
    width_mm: float
    since_s: float


_RESET = Refusal(
    "not_enabled",
    "the motor reports that it is off, which nobody here asked for: its supply failed for a moment,"
    " or another program disabled it",
)


def released_by_fault(held: HeldObject, motor: MotorView) -> Event:
    """Report that a held object has been let go, or must be taken for let go, by nobody's wish."""
    why = motor.fault or motor.problem or _RESET
    if motor.phase is MotorPhase.UNKNOWN:
        why = _RESET
    is_certain = motor.phase is not MotorPhase.SILENT
    what = f"what was held with {held.force_n:g} N, at {held.width_mm:.1f} mm,"
    if is_certain:
        text = sentence("{what} has been let go: {why}", what=what, why=why.message)
    else:
        text = sentence(
            "{what} must be taken for let go: the motor has not answered for {within_s:g} s, and"
            " without power or commands it lets go by itself: {why}",
            what=what,
            within_s=RELEASES_WITHIN_S,
            why=why.message,
        )
    data = {"force_n": held.force_n, "width_mm": round(held.width_mm, 2), "certain": is_certain}
    past = f"{what} was let go{_past_cause(why, is_certain=is_certain)}"
    told = {"reason": why.reason, "why": why.message, "past": past}
    return Event("released_by_fault", text, {**data, **told})


def _past_cause(why: Refusal, *, is_certain: bool) -> str:
    """Return why something was let go, as it reads once that is over and needs no advice."""
    if not is_certain:
        return ": the motor did not answer"
    if why is _RESET:
        return ": the motor was off, which nobody here had asked for"
    if why.reason == "implausible_feedback":
        return ": the motor's position jumped, and it was disabled"
    status = why.data.get("status")
    return " by a fault" if status is None else f" by a fault ({str(status).replace('_', ' ')})"


RELEASES_WITHIN_S = LATEST_DISARM_S + 0.1
"""A motor that gets no commands has let go by then, as far as motors were seen; later than that the
daemon no longer takes up a hold, but disables a motor that comes back enabled."""


def pressing(lasting: Pressing, geometry: Geometry, kind: JobKind, running: Job | None) -> Event:
    """Report that the jaws press on something and go on, with the motion that led them there."""
    pressing_n = abs(geometry.force_n(lasting.torque_nm))
    most_n = abs(geometry.force_n(lasting.most_nm))
    lowered = f" ({most_n:.1f} N before)" if most_n > pressing_n * 1.05 else ""
    state = "has left them there" if running is None else "continues"
    text = sentence(
        "the jaws press with {pressing_n:.1f} N{lowered} on what is in their way: {kind} {state};"
        " open them, or let them go ({motion.zero_gravity})",
        pressing_n=pressing_n,
        lowered=lowered,
        kind=kind,
        state=state,
    )
    number = None if running is None else running.number
    data = {"pressing_n": round(pressing_n, 1), "most_n": round(most_n, 1), "kind": kind}
    return Event("pressing", text, {**data, "job": number})


def swings(share: float) -> Event:
    """Report that the jaws swung in a hold, and with what share of its gains they are held now."""
    text = (
        f"the jaws swing by themselves: they are held with {share:.0%} of stiffness and damping"
        " until the motor is enabled again"
    )
    return Event("swing", text, {"share": share})


def heat_changed(change: HeatChange) -> Event:
    """Report that the coil's heat changes the limit of the torque."""
    data = {"from_nm": _finite(change.from_nm), "to_nm": _finite(change.to_nm)}
    return Event("heat", change.why, {**data, "coil_c": change.coil_c})


def heat_foretold(force_n: float, bears_s: float, heat: HeatGuard) -> Event:
    """Report, before a hold, that the coil bears its force for a limited time only."""
    coil_c = heat.model.coil_c
    at = "" if coil_c is None else f"at {coil_c:.0f} °C now, "
    text = (
        f"{force_n:g} N can be held for about {bears_s:.0f} s: the coil, {at}is at its limit of"
        f" {heat.limit_c:.0f} °C then, and less force is held"
    )
    return Event("heat", text, {"force_n": force_n, "bears_s": round(bears_s, 1), "coil_c": coil_c})


def weak(made: MadeTorque) -> Event:
    """Report that the motor makes less torque than is commanded, or makes it again."""
    data: dict[str, object] = {"weak": made.is_weak}
    data |= {"made_nm": made.made_nm, "commanded_nm": made.commanded_nm, "warning": made.is_weak}
    data["hint"] = WEAK_HINT if made.is_weak else None
    text = weak_text(made) if made.is_weak else "the motor makes the commanded torque again"
    return Event("weak", text, data)


WEAK_HINT = (
    "check the supply's voltage and current, the motor's registers OC_Value and KT_Value, and its"
    " winding"
)


def weak_text(made: MadeTorque) -> str:
    """Return what is wrong with a weak motor, and what to do."""
    return (
        f"the motor makes {made.made_nm:.2f} N·m of the commanded {made.commanded_nm:.2f} N·m, by"
        f" its own report: what is held is held by less than was asked for; {WEAK_HINT}"
    )


def calibrated(calibration: Calibration, file: str | None, doubts: Sequence[str]) -> Event:
    """Report the calibration in use, and which way closing runs by it; doubts make it a warning."""
    geometry = calibration.geometry
    turning = "increasing" if geometry.close_sign > 0 else "decreasing"
    usable = "" if calibration.calibrated else "; NOT calibrated: motions are refused"
    text = (
        f"calibration {file or 'given by a client'}: mount {geometry.mount}, closing by {turning}"
        f" radians, {geometry.travel_mm:.1f} mm of travel{usable}"
    )
    beyond = work_stroke_warning(calibration)
    if beyond is not None:
        text += f"; its {beyond}"
    data: dict[str, object] = {"mount": geometry.mount, "file": file}
    if doubts:
        text, data = joined("; ", [text, *doubts]), {**data, "warning": True}
    return Event("calibration", text, data)


def doubted(given: Calibration, stroke_mm: float, by: Owner) -> Event:
    """Report a client whose motions bring a calibration with a scale that is probably wrong."""
    geometry, (low, high) = given.geometry, USUAL_RAD_TO_MM
    text = (
        f"{by.program} (pid {by.pid}) moves by a calibration of its own, with"
        f" {geometry.rad_to_mm:.4g} mm/rad and {geometry.travel_mm:.4g} mm of travel: grippers of"
        f" {low:g} to {high:g} mm/rad were seen, and these jaws open {stroke_mm:g} mm by the"
        " configuration. Its lengths and speeds in mm are probably wrong: correct its limits or its"
        " rad_to_mm"
    )
    return Event("calibration", text, {"pid": by.pid, "warning": True})


def not_saved(error: str) -> Event:
    """Report that the file still holds an outdated calibration."""
    text = (
        f"the calibration file still holds the outdated calibration; it was not rewritten: {error}"
    )
    return Event("calibration", text, {"error": error})


_FIGURES: Mapping[str, str] = {
    "message": "{}",
    "tries": "tries: {}",
    "cleared": "{} cleared",
    "width_mm": "{:.1f} mm wide",
    "force_n": "{:.1f} N",
    "held_s": "held for {:.1f} s",
    "target_rad": "target {}",
    "position_rad": "at {}",
    "travel_rad": "{:.3f} rad of travel",
    "shift_rad": "shifted by {:.3f} rad",
    "largest_lag_mm": "at most {:.1f} mm behind",
    "set_points": "set-points: {}",
    "samples": "samples: {}",
    "missed": "missed: {}",
    "loops": "loops: {}",
    "grips": "grips: {}",
    "frames": "frames: {}",
    "rejected": "rejected: {}",
    "send_failed": "not sent: {}",
    "torque_trips": "torque trips: {}",
}
"""How a figure of a result reads, in this order; others are for programs, as flags and limits."""
_FIGURES_OF_WEAK = {"width_mm": "at {:.1f} mm", "force_n": "{:.1f} N asked for"}
"""Of a motor that makes less than that: whether anything is held is not known."""


def _worded(result: Result, geometry: Geometry | None) -> str:
    """Return how a job ended, and its figures that have a value, as a person reads it.

    Beyond a stop a target is how hard the jaws press there, and a grasp's is where it ends without
    an object: these say nothing to a person.
    """
    outcome, ok = getattr(result, "outcome", None), getattr(result, "ok", True)
    shown: list[str] = [outcome.replace("_", " ")] if outcome else [] if ok else ["NOT ok"]
    weak = _FIGURES_OF_WEAK if outcome == "motor_weak" else {}
    for name, form in {**_FIGURES, **weak}.items():
        value = getattr(result, name, None)
        if value is None or (name == "target_rad" and isinstance(result, GraspResult)):
            continue
        if name in ("target_rad", "position_rad"):
            if geometry is None:
                shown.append(form.format(f"{value:.3f} rad"))
                continue
            opening_mm = round(geometry.opening_mm(value), 1) + 0.0  # never -0.0
            if name == "position_rad" or 0.0 <= opening_mm <= round(geometry.travel_mm, 1):
                shown.append(form.format(f"{opening_mm:.1f} mm"))
        elif value != (1 if name == "tries" else 0):
            shown.append(value if form == "{}" else form.format(value))
    return joined(", ", shown) if shown else "ok"


def _finite(torque_nm: float) -> float | None:
    return torque_nm if math.isfinite(torque_nm) else None


def stop_cleared(by: Owner, repeats: int) -> Event:
    """Report who allowed motions again, and how many stops came without an event."""
    text = f"stop cleared by {by.program} (pid {by.pid})"
    if repeats:
        text += f"; {repeats} more came while it was latched"
    return Event("stop_cleared", text, {"repeats": repeats})


def stopped(stop: Stop) -> Event:
    """Report the latched stop; what is still to be done is in the state."""
    return Event("stop", said_of(stop), {"level": stop.level})


def lease_lost(loss: Loss) -> Event:
    """Report whose lease is lost, why, and who has it."""
    text = f"lease {loss.grant} of {_named(loss.owner)} is lost: {loss.text}"
    return Event("lease_lost", text, loss.notice)


def lease_granted(grant: Grant) -> Event:
    """Report who got the lease, and for what purpose."""
    owner, purpose = grant.owner, grant.options.purpose
    why = "" if purpose is None else f" for {purpose}"
    text = f"lease {grant.number} granted to {_named(owner)}{why}"
    data = {"client": owner.client, "pid": owner.pid, "lease": grant.number, "held": True}
    return Event("lease", text, data)


def lease_released(grant: Grant, by: Owner) -> Event:
    """Report who released the lease; its token allows another connection to do so."""
    owner = grant.owner
    whose = "" if by.client == owner.client else f", in the place of {_named(owner)}"
    text = f"lease {grant.number} given back by {_named(by)}{whose}"
    data = {"client": owner.client, "pid": owner.pid, "lease": grant.number, "held": False}
    return Event("lease", text, {**data, "by": {"client": by.client, **process_of(by)}})


def _named(owner: Owner) -> str:
    return f"{owner.program} (pid {owner.pid}, uid {owner.uid})"


def loss_refusal(loss: Loss | None, *, is_owner: bool = True) -> Refusal:
    """Return why a motion ends together with its client (`is_owner`) or its lease."""
    if loss is None or loss.cause in ("connection", "process"):
        on_lost = "hold" if loss is None else loss.on_lost
        whose = "that owned it" if is_owner else "under whose lease it ran"
        text = f"the client {whose} went away"
        return Refusal("client_lost", text, {"on_lost": on_lost})
    text = f"the lease under which it ran is lost: {loss.text}"
    return Refusal("lease_lost", text, {**loss.data, "hint": method_name("lease.acquire")})


def taken_refusal(by: Owner, why: str, left: OnLost) -> Refusal:
    """Return why a motion ends when somebody takes the gripper over."""
    data = {"on_lost": left, "cause": "taken", "why": why, "by": process_of(by)}
    data |= {"hint": method_name("lease.acquire")}
    return Refusal("lease_lost", f"the gripper was taken over by {_named(by)}: {why}", data)


_LOSERS = {
    "expired": "the client that had the gripper is silent",
    "taken": "the gripper was taken over",
}


def client_lost(on_lost: OnLost, cause: LossCause | None, *, later: bool) -> Event:
    """Report what the jaws do after the loss of a client, or of a client's lease."""
    when = ", once the running motion has ended" if later else ""
    what = _LOSERS.get(cause or "connection", "the client that had the gripper is gone")
    text = f"{what}: the jaws {_ON_LOST_TEXT[on_lost]}{when}"
    return Event("client_lost", text, {"on_lost": on_lost})


def left_to_holder() -> Event:
    """Report that a lost client's choice for the jaws no longer counts."""
    text = "the gripper has a client again: what the jaws do then is that client's to say"
    return Event("lease", text)


def motor_changed(before: MotorView, now: MotorView) -> list[Event]:
    """Report a change of the motor's phase, fault or registers, and why it was disabled."""
    events = []
    fault, problem = now.fault, now.problem
    if now.phase is not before.phase or (fault is not None and fault != before.fault):
        texts = [f"motor: {before.phase.value} -> {now.phase.value}"]
        data: dict[str, object] = {"phase": now.phase.value}
        if fault is not None:
            texts.append(fault.message)
            data |= {"error": fault.message, **fault.data}
        events.append(Event("motor", joined(": ", texts), data))
    if problem is not None and now.has_jumped and before.phase is MotorPhase.ENABLED:
        events.append(Event("implausible", problem.message, problem.data))
    old, new = before.identity, now.identity
    if old is None or new is None or new is old:
        return events
    known = old.registers
    changed = {name: value for name, value in new.registers.items() if value != known.get(name)}
    if changed:
        worded = ", ".join(f"{name} is {value}" for name, value in changed.items())
        text = f"the motor's registers have changed: {worded}; what was read is used from now on"
        finite = {
            name: None if value is None else _finite(value) for name, value in changed.items()
        }
        events.append(Event("motor", text, {"registers": finite, "error": text}))
    return events


def bus_changed(
    before: BusCondition, now: BusCondition, bus_channel: str, *, is_missed: bool
) -> Event:
    """Report a change of the bus's state, and what to do about it.

    A bus on which nobody answers is at rest unless the motor is missed: its power may be off.
    """
    text = "CAN bus: " + ("" if before.state == now.state else f"{before.state} -> ") + now.state
    hint = remedy(now.state, bus_channel)
    if now.error is not None:
        text += f": {now.error}"
    if hint is not None and now.state != "motor_silent":  # its error says what to do
        text += f" ({hint})"
    data: dict[str, object] = {"state": now.state, "error": now.error, "hint": hint}
    if now.state in UNANSWERED and not is_missed:
        text, data = f"{text}; nobody uses the gripper", {**data, "at_rest": True}
    return Event("bus", text, data)
