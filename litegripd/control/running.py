"""What runs: the one job, those that wait for its end, and what the jaws do without one.

What happens here happens between two ticks; it reaches the motor only by the engine's next step.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

from litegripd.control import announce
from litegripd.control.actions.base import Action
from litegripd.control.admission import ENDING, busy_refusal
from litegripd.control.grip import Grip
from litegripd.control.in_use import CalibrationInUse
from litegripd.control.jobs import MOST_QUEUED, JobBook
from litegripd.control.lease import Lease
from litegripd.control.rest import Hold, Relax, Rest
from litegripd.control.second_master import SecondMaster
from litegripd.control.stop import StopLatch
from litegripd.model.errors import Refusal
from litegripd.model.events import Event
from litegripd.model.jobs import Job, JobKind, OnLost, Owner, StopLevel
from litegripd.model.motor import MotorPhase, MotorView
from litegripd.model.results import Result

Start: TypeAlias = Callable[[], Job | Refusal]
"""Asks for a motion again, as its request did: it may be refused by now."""


_Begun = TypeVar("_Begun")


@dataclass(frozen=True, slots=True)
class _Queued:
    job: Job
    start: Start


class Running:
    """At most one job runs; else a rest holds the jaws or lets them go."""

    def __init__(self) -> None:
        self.jobs = JobBook()
        self.lease = Lease()
        self.stop_latch = StopLatch()
        self.second_master = SecondMaster()
        self.calibrated = CalibrationInUse()
        self.motor = MotorView(MotorPhase.UNKNOWN)
        self.now_s = 0.0
        self.rest: Rest = Relax()
        self.action: Action | None = None
        self.has_stepped = False
        """Whether the present or latest action has had any say in what the motor is told."""
        self.events: list[Event] = []
        self.must_disable = False
        self._is_ending = False
        self._owed: OnLost | None = None
        self._queue: deque[_Queued] = deque()
        self._starting: Job | None = None
        self._replaced: Refusal | None = None

    @property
    def grip(self) -> Grip | None:
        """The hold by force, if there is one, be it a grasp's or what one has left."""
        if self._replaced is not None:
            rest: Rest | None = self._left()
        else:
            rest = self.rest if self.action is None else self.action.rest()
        return rest if isinstance(rest, Grip) else None

    @property
    def in_the_way(self) -> Job | None:
        """The running job, but for one that the next motion replaces."""
        return None if self._replaced is not None else self.jobs.running

    # Jobs

    def unfree(self) -> Refusal | None:
        """Say why no motion may be asked for: the end, a stop, another master or a motion."""
        ending = ENDING if self._is_ending else None
        refused = ending or self.stop_latch.refusal() or self.second_master.refusal()
        return refused or busy_refusal(self.in_the_way)

    @property
    def is_ending(self) -> bool:
        """Whether the daemon's end has begun."""
        return self._is_ending

    def unsettled(self) -> Refusal | None:
        """Say why no successor can take over now: the daemon's end, a motion, or a disabling."""
        ending = ENDING if self._is_ending else None
        refusal = ending or busy_refusal(self.jobs.running)
        if refusal is None and (self._queue or self.must_disable):
            refusal = Refusal("busy", "a motion, or disabling the motor, is about to begin")
        return refusal

    def begin(self, kind: JobKind, action: Action, owner: Owner, detached: bool) -> Job:
        """Begin a job; the caller has made sure that it may."""
        self._end_replaced()
        job = self._new_job(kind, owner, detached)
        self.jobs.begin(job, self.now_s)
        self.action, self.has_stepped = action, False
        self.events.append(announce.job_started(job))
        return job

    def settle(self, kind: JobKind, rest: Rest, owner: Owner, result: Result) -> Job:
        """Change at once what the jaws do without a motion; the job has ended when it returns."""
        self._end_replaced()
        self.rest = rest
        job = self._new_job(kind, owner, detached=True)
        self.jobs.begin(job, self.now_s)
        self.events.append(announce.job_started(job))
        self.end(result)
        return job

    def _left(self, *, by_defect: bool = False) -> Rest:
        """Return what the jaws do if the running action ends now."""
        action, feedback = self.action, self.motor.feedback
        if action is None or feedback is None or not (action.needs_power and self.has_stepped):
            return self.rest
        rest = None if by_defect else action.rest()
        return rest or Hold(feedback.position_rad, self.calibrated.gains)

    def replace(self, reason: Refusal, start: Callable[[], _Begun]) -> _Begun:
        """Begin another motion in the place of the running one, which ends by `reason`.

        It ends when the other one begins: one that is refused leaves it running.
        """
        self._replaced = reason
        try:
            return start()
        finally:
            self._replaced = None

    def _end_replaced(self) -> None:
        reason, self._replaced = self._replaced, None
        if reason is not None:
            self.end(reason)

    def queue(self, kind: JobKind, owner: Owner, detached: bool, start: Start) -> Job | Refusal:
        """Let a motion wait for the end of the running one; `start` is called then."""
        if len(self._queue) >= MOST_QUEUED:
            text = f"{MOST_QUEUED} motions wait for their turn already"
            return Refusal("too_many_requests", text, {"limit": MOST_QUEUED})
        job = self.jobs.add(kind, owner, detached, self.now_s)
        self._queue.append(_Queued(job, start))
        return job

    def end(self, outcome: Result | Refusal, *, by_defect: bool = False) -> None:
        """End the running job; what the jaws do then is its action's to say, else they hold.

        An action that failed `by_defect` is not asked: they hold where they are.
        """
        job, action = self.jobs.running, self.action
        if job is None:
            self.action = None
            return
        self.jobs.end(job, outcome, self.now_s)
        self.rest, self.action = self._left(by_defect=by_defect), None
        broken_off = job.kind == "enable" and isinstance(outcome, Refusal)
        if broken_off and self.motor.phase is not MotorPhase.ENABLED:
            self.must_disable = True  # it may still take effect
        owed, self._owed = self._owed, None
        if owed is not None:
            self._settle_into(owed)
        self.events += announce.job_ended(job, outcome)
        if action is not None:
            action.close()

    def break_off(self, error: Exception) -> None:
        """End the job that runs, or was to begin, in the tick in which a defect raised `error`.

        It would fail in every tick, and the motor be told nothing.
        """
        starting, self._starting = self._starting, None
        if starting is not None:
            self._end_queued(starting, _defect(starting, error))
        running = self.jobs.running
        if running is not None:
            self.must_disable = self.must_disable or running.kind == "disable"
            self.end(_defect(running, error), by_defect=True)

    def cancel(self, number: int, by: Owner) -> Job | Refusal:
        """End a job; the jaws go on holding what they hold, else where they are."""
        job = self.jobs.get(number)
        if job is None:
            return Refusal("unknown_job", f"there is no job {number}, or it is no longer kept")
        who = f"{by.program} (pid {by.pid})"
        cancelled = Refusal("cancelled", f"cancelled by {who}", {"by": who})
        if job is self.jobs.running:
            self.end(cancelled)
        else:
            self._drop_queued(cancelled, lambda queued: queued is job)
        return job

    def _new_job(self, kind: JobKind, owner: Owner, detached: bool) -> Job:
        """Return the queued job whose turn it is, else a new one, under the present lease."""
        job, self._starting = self._starting, None
        job = job or self.jobs.add(kind, owner, detached, self.now_s)
        holder = self.lease.holder
        job.grant = None if holder is None else holder.number
        return job

    def _start_queued(self) -> None:
        """Start the motion whose turn it is; one that is refused by now ends so."""
        while self._queue and self.jobs.running is None:
            entry = self._queue.popleft()
            self._starting = entry.job
            refused = self.lease.refusal(entry.job.owner) or entry.start()
            self._starting = None
            if isinstance(refused, Refusal):
                self._end_queued(entry.job, refused)

    def _drop_queued(self, refusal: Refusal, which: Callable[[Job], bool]) -> None:
        dropped = [entry for entry in self._queue if which(entry.job)]
        self._queue = deque(entry for entry in self._queue if not which(entry.job))
        for entry in dropped:
            self._end_queued(entry.job, refusal)

    def _end_queued(self, job: Job, refusal: Refusal) -> None:
        self.jobs.end(job, refusal, self.now_s)
        self.events += announce.job_ended(job, refusal)

    def _settle_into(self, level: StopLevel) -> None:
        """Go into what a stop or a lost client leaves behind; a hold is kept, force included."""
        if level == "disable" or (level == "relax" and self.motor.phase is MotorPhase.SILENT):
            self.must_disable = True  # a motor that does not answer can only be told to let go
        elif level == "relax":
            self.rest = Relax()
        elif isinstance(self.rest, Grip):
            self.rest.stay()


def _defect(job: Job, error: Exception) -> Refusal:
    text = f"{job.kind} failed by a defect: {type(error).__name__}: {error}"
    return Refusal("internal_error", text)
