"""Who runs what: the one running job, its queue, the lease, the stop, and clients that are lost.

What happens here happens between two ticks; it reaches the motor only by the engine's next step.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from litegripd.control import announce
from litegripd.control.actions.base import Action
from litegripd.control.admission import ENDING, busy_refusal, busy_with
from litegripd.control.grip import Grip
from litegripd.control.in_use import CalibrationInUse
from litegripd.control.jobs import MOST_QUEUED, JobBook
from litegripd.control.lease import Grant, Lease, Loss, LossCause, OnAnswer, Wish
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


@dataclass(frozen=True, slots=True)
class _Queued:
    job: Job
    start: Start


class Arbiter:
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
        self.events: list[Event] = []
        self.must_disable = False
        self._is_ending = False
        self._owed: OnLost | None = None
        self._queue: deque[_Queued] = deque()
        self._starting: Job | None = None

    @property
    def grip(self) -> Grip | None:
        """The hold by force, if there is one, be it a grasp's or what one has left."""
        rest = self.rest if self.action is None else self.action.rest()
        return rest if isinstance(rest, Grip) else None

    # Jobs

    def unfree(self) -> Refusal | None:
        """Say why no motion may be asked for: the end, a stop, another master or a motion."""
        ending = ENDING if self._is_ending else None
        refused = ending or self.stop_latch.refusal() or self.second_master.refusal()
        return refused or busy_refusal(self.jobs.running)

    def begin(self, kind: JobKind, action: Action, owner: Owner, detached: bool) -> Job:
        """Begin a job; the caller has made sure that it may."""
        job = self._new_job(kind, owner, detached)
        self.jobs.begin(job, self.now_s)
        self.action = action
        self.events.append(announce.job_started(job))
        return job

    def settle(self, kind: JobKind, rest: Rest, owner: Owner, result: Result) -> Job:
        """Change at once what the jaws do without a motion; the job has ended when it returns."""
        self.rest = rest
        job = self._new_job(kind, owner, detached=True)
        self.jobs.begin(job, self.now_s)
        self.end(result)
        return job

    def queue(self, kind: JobKind, owner: Owner, detached: bool, start: Start) -> Job | Refusal:
        """Let a motion wait for the end of the running one; `start` is called then."""
        if len(self._queue) >= MOST_QUEUED:
            text = f"{MOST_QUEUED} motions wait for their turn already"
            return Refusal("too_many_requests", text, {"limit": MOST_QUEUED})
        job = self.jobs.add(kind, owner, detached, self.now_s)
        self._queue.append(_Queued(job, start))
        return job

    def end(self, outcome: Result | Refusal) -> None:
        """End the running job; what the jaws do then is its action's to say, else they hold."""
        job, action, self.action = self.jobs.running, self.action, None
        if job is None:
            return
        self.jobs.end(job, outcome, self.now_s)
        feedback = self.motor.feedback
        if action is not None and action.needs_power and feedback is not None:
            gains = self.calibrated.gains
            self.rest = action.rest() or Hold(feedback.position_rad, gains)
        if action is not None:
            action.close()
        broken_off = job.kind == "enable" and isinstance(outcome, Refusal)
        if broken_off and self.motor.phase is not MotorPhase.ENABLED:
            self.must_disable = True  # it may still take effect
        owed, self._owed = self._owed, None
        if owed is not None:
            self._settle_into(owed)
        self.events += announce.job_ended(job, outcome)

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

    # Stop

    def stop(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> None:
        """Stop, in force with the next command that is sent, and latched.

        One that raises nothing takes effect all the same, but is only counted: a flood of stops
        is no flood of events.
        """
        before = self.stop_latch.latched
        stop = self.stop_latch.raise_to(level, by, why, now_s)
        refusal = self.stop_latch.refusal()
        if refusal is not None:
            running = self.jobs.running
            if running is not None and running.kind != "disable":
                self.end(refusal)
            self._drop_queued(refusal, lambda _job: True)
            if stop is not before:
                self.events.append(announce.stopped(stop.level, refusal))
        self._settle_into(stop.level)
        if isinstance(self.rest, Grip):
            self.rest.freeze()  # no more torque than there is now, but not a dropped object either

    def clear_stop(self, by: Owner) -> None:
        """Allow motions again; the jaws stay as they are."""
        if self.stop_latch.latched is not None:
            self.events.append(announce.stop_cleared(by, self.stop_latch.clear()))

    def shut_down(self) -> None:
        """Begin the daemon's end: what runs is cancelled, the motor disabled, all else refused."""
        self._is_ending = True
        self.end(ENDING)
        self._drop_queued(ENDING, lambda _job: True)
        self.must_disable = True

    # The lease

    def acquire(self, owner: Owner, wish: Wish) -> Grant | Refusal:
        """Grant the lease, where it is free and nobody else's motion runs."""
        before, running = self.lease.holder, self.jobs.running
        if before is None and running is not None and running.owner.client != owner.client:
            return busy_with(running)
        answer = self.lease.acquire(owner, wish, self.now_s)
        is_new = isinstance(answer, Grant) and (before is None or answer.number != before.number)
        return self._granted(answer) if is_new else answer

    def await_lease(
        self, owner: Owner, wish: Wish, wait_s: float, on_answer: OnAnswer
    ) -> Refusal | None:
        """Let `owner` wait for the lease, first come, first served."""

        def granted(answer: Grant | Refusal) -> None:
            on_answer(self._granted(answer))

        return self.lease.wait(owner, wish, self.now_s + wait_s, granted)

    def release(self, owner: Owner) -> Refusal | None:
        """Give the lease back; a motion that runs under it goes on."""
        holder, running = self.lease.holder, self.jobs.running
        refusal = self.lease.release(owner)
        if refusal is None and holder is not None:
            self.events.append(announce.lease_changed(holder, held=False))
            if running is not None and running.grant == holder.number:
                running.grant = None
        return refusal

    def take_over(self, owner: Owner, wish: Wish, why: str) -> Grant:
        """Take the lease from whoever has it; the caller has made sure that `owner` may."""
        grant, loss = self.lease.take(owner, wish, why, self.now_s)
        if loss is not None:
            self.lose(loss, loss.grant.owner.client)
        self._granted(grant)
        return grant

    def resume(self, number: int, owner: Owner) -> Grant | Refusal:
        """Grant a lapsed lease again to who reconnected, if nobody has had one since."""
        return self._granted(self.lease.resume(number, owner, self.now_s))

    def _granted(self, answer: Grant | Refusal) -> Grant | Refusal:
        if isinstance(answer, Grant):
            self.events.append(announce.lease_changed(answer, held=True))
        return answer

    # Lost clients and lost leases

    def client_lost(self, client: int, cause: LossCause = "connection") -> None:
        """End what a client owned: its motions, unless detached, and its lease."""
        self.lose(self.lease.lose(client, cause), client)

    def lose(self, loss: Loss | None, client: int) -> None:
        """End the motion of a lost client or lease; then the jaws do what was wished.

        That is done at once, or when the motion has ended that goes on without its client: a
        detached one, or another client's. Disabling always goes on.
        """
        running = self.jobs.running
        refusal = announce.loss_refusal(loss)
        self._drop_queued(refusal, lambda job: _falls(job, loss, client))
        ends = running is not None and running.kind != "disable" and _falls(running, loss, client)
        if ends:
            self.end(refusal)
        on_lost: OnLost = "hold" if loss is None else loss.grant.wish.on_lost
        later = loss is not None and self.jobs.running is not None
        if loss is not None:
            self.events.append(announce.lease_lost(loss))
        if ends or loss is not None:
            self.events.append(announce.client_lost(on_lost, later=later))
        if later:
            self._owed = on_lost
        elif ends or loss is not None:
            self._settle_into(on_lost)

    def _step_authority(self, now_s: float) -> None:
        """Take what time brings: a lease that runs out, and whose turn it is.

        A motion under a lease that is not the present one never goes on, whatever the way.
        """
        loss = self.lease.expire(now_s)
        if loss is not None:
            self.lose(loss, loss.grant.owner.client)
        running, holder = self.jobs.running, self.lease.holder
        present = None if holder is None else holder.number
        if running is not None and not running.detached and running.grant not in (None, present):
            self.end(announce.loss_refusal(None))
        self._start_queued()
        self.lease.step(now_s, may_grant=self.jobs.running is None and not self._queue)

    def _settle_into(self, level: StopLevel) -> None:
        """Go into what a stop or a lost client leaves behind; a hold is kept, force included."""
        if level == "disable" or (level == "relax" and self.motor.phase is MotorPhase.SILENT):
            self.must_disable = True  # a motor that does not answer can only be told to let go
        elif level == "relax":
            self.rest = Relax()


def _falls(job: Job, loss: Loss | None, client: int) -> bool:
    """Whether a job ends with its client, or with the lease that it runs under."""
    if job.detached:
        return False
    under = loss is not None and job.grant == loss.grant.number
    return under or job.owner.client == client
