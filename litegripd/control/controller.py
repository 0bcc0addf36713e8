"""The controller: the one place that decides, in every tick, what the motor gets.

Pure: `step(now_s, motor)` returns what the motor is to do in this tick. Between ticks clients ask
for motions (`requests` begins them), ask for a stop, or are lost. All of that reaches the motor
only through `step`.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from litegripd.control import events
from litegripd.control.admission import (
    ENDING,
    FOLLOWED,
    NOT_ENABLED,
    ZERO_MOVED,
    busy_refusal,
    busy_with,
    motor_refusal,
    position_refusal,
    stopped_under_way,
)
from litegripd.control.authority import (
    Grant,
    Lease,
    LeaseOptions,
    Loss,
    LossCause,
    SecondMaster,
    StopLatch,
)
from litegripd.control.calibration import CalibrationInUse, Terms, content_of, save_task
from litegripd.control.detectors import PressWatch, WayGauge
from litegripd.control.events import (
    NOW,
    RELEASES_WITHIN_S,
    JobBook,
    RegisterReads,
    Turn,
)
from litegripd.control.holds import Grip, Hold, Idle, Slack
from litegripd.control.limiter import (
    CATCHING_GAINS,
    Easing,
    Gains,
    Output,
    SwingGuard,
    bounds_of,
)
from litegripd.control.motions.base import Action
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry, GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import (
    NOT_OPENED,
    BusCondition,
    DisableMotor,
    Feedback,
    MitCommand,
    MotorInput,
    MotorPhase,
    MotorRequest,
    MotorView,
    Ranges,
    ZeroView,
)
from litegripd.model.plain import Carried
from litegripd.model.sentence import method_name, sentence
from litegripd.model.state import (
    DisableResult,
    Event,
    HelperTask,
    Job,
    JobKind,
    JobState,
    OnLost,
    Owner,
    Progress,
    Result,
    StopLevel,
    TaskResult,
)

_SAFE_JOBS = ("disable", "clear_fault")
"""The jobs that continue while another program commands the motor: they energise nothing."""

_POWERED = (MotorPhase.ENABLING, MotorPhase.ENABLED, MotorPhase.DISABLING)
_OFF = (MotorPhase.DISABLED, MotorPhase.FAULT)

_MOTOR_REASONS = ("motor_silent", "bus_down", "motor_fault")
"""Who gets such a refusal wanted to use the motor, and could not."""

FORETELL_EVERY_S, FORETELL_MORE = 600.0, 1.1
"""How often it is said that a hold is too hot to last, and by how much more a force is said again.
A program that grasps again and again must not fill the journal."""


class Recording(Protocol):
    """A recording of the jaws' motion, as far as the controller needs it."""

    is_over: bool
    is_taken: bool  # to where it is kept
    samples: int

    @property
    def would_be_lost(self) -> bool:
        """True if it is good and kept nowhere else."""

    def step(
        self,
        now_s: float,
        motor: MotorView,
        geometry: Geometry | None,
        grip: Grip | None,
        jobs: JobBook,
    ) -> None:
        """Take a tick's measurement, and the present grip."""


class Controller:
    """Runs one gripper: at most one job, else idle jaws: a hold, a grip, or slack.

    It also has the authority: the software stop, the lease, and lost clients. All requests between
    two ticks reach the motor only by the next `step`.
    """

    config: Carried[MotionConfig]
    config_is_kept: Carried[bool] = False
    now_s: Carried[float] = 0.0
    ticks: Carried[int] = 0
    bus: Carried[BusCondition] = NOT_OPENED
    calibrated: Carried[CalibrationInUse]
    in_force: Carried[Terms]
    second_master: Carried[SecondMaster]
    jobs: Carried[JobBook]
    lease: Carried[Lease]
    stop_latch: Carried[StopLatch]
    output: Carried[Output]
    pressing: Carried[PressWatch]
    _easing: Carried[Easing]
    _moved_by: Carried[JobKind] = "enable"
    """The motion that has led the jaws last."""
    swing: Carried[SwingGuard]
    recordings: Carried[int] = 0
    missed: Carried[Refusal | None] = None
    """Why a client's request for the motor has failed, until the motor can be used again."""
    _is_powered: Carried[bool] = False
    NOT_CARRIED = (
        "action",
        "capture",  # `why_not_restartable` if it would be lost
        "events",
        "gripper_id",
        "has_stepped",
        "register_reads",
        "motor",  # only its phase, beside this
        "way",  # for two seconds only
        "must_disable",
        "period_s",
        "idle",  # beside this
        "tasks",
        "_asked_off",
        "_foretold_n",
        "_foretold_s",
        "_held",  # a motor is handed over only while it answers
        "ending",
        "_owed",
        "_ranges",
    )

    def __init__(
        self, config: MotionConfig, period_s: float, gripper_id: GripperId | None = None
    ) -> None:
        self.config = config
        self.period_s = period_s
        self.gripper_id = gripper_id or GripperId()
        self.motor = MotorView(MotorPhase.UNKNOWN)
        self.calibrated = CalibrationInUse()
        self.in_force = self.terms
        self.second_master = SecondMaster()
        self.jobs = JobBook()
        self.lease = Lease()
        self.stop_latch = StopLatch()
        self.action: Action | None = None
        self.has_stepped = False
        """True if the present or latest action has had any effect on what the motor gets."""
        self.idle: Idle = Slack()
        self.output = Output(self.gripper_id.motor_type)
        self.pressing = PressWatch(self.gripper_id.motor_type)
        self.way = WayGauge()
        self._easing = Easing()
        self.swing = SwingGuard(self.gripper_id.motor_type)
        self.register_reads = RegisterReads()
        self.capture: Recording | None = None
        self.events: list[Event] = []
        self.tasks: list[HelperTask] = []
        self.must_disable = False
        self._foretold_n, self._foretold_s = 0.0, -math.inf
        self._held: events.HeldObject | None = None
        """What was held by force, from when the motor stopped being enabled until that is told."""
        self._asked_off = False
        self._ranges: Ranges | None = None
        self.ending: Refusal | None = None
        """Why all is rejected, once the end of the daemon, or its retirement, has begun."""
        self._owed: OnLost | None = None

    @property
    def geometry(self) -> Geometry | None:
        """The calibrated travel, None while uncalibrated."""
        return self.calibrated.geometry

    @property
    def gains(self) -> Gains:
        """The gains of holds and moves: the calibration's, else the default."""
        return self.calibrated.gains

    @property
    def terms(self) -> Terms:
        """What a motion counts on that brings nothing of its own."""
        return self.calibrated.terms(self.config)

    @property
    def grip(self) -> Grip | None:
        """The present hold by force, of a running grasp or after one; None without one."""
        idle = self.idle if self.action is None else self.action.idle_after()
        return idle if isinstance(idle, Grip) else None

    @property
    def _is_pushed(self) -> bool:
        """True while the running motion drives the jaws by a torque that its caller has set."""
        return self.action is not None and self.action.by_force

    def grip_at(self, turn: Turn) -> Grip | None:
        """Return the hold by force that a motion which begins at its turn would find, or None."""
        if turn.replaces is None:
            return self.grip
        left = self._left()
        return left if isinstance(left, Grip) else None

    def in_the_way(self, turn: Turn = NOW) -> Job | None:
        """Return the running job, or the queued one that is next, unless it is the turn's own."""
        jobs = self.jobs
        if turn.replaces is not None:
            return None
        if jobs.running is None and jobs.queue and turn.queued is None:
            return jobs.queue[0].job
        return jobs.running

    @property
    def is_missed(self) -> bool:
        """True if somebody needs the motor: what keeps it from being used is an alarm only then.

        It was being enabled, or enabled, and has not reported since that it is off; or somebody has
        the lease, or a motion; or a client's request has failed for it.
        """
        jobs = self.jobs
        in_use = self._is_powered or self.lease.holder is not None
        return in_use or jobs.running is not None or bool(jobs.queue) or self.missed is not None

    def note_refused(self, refusal: Refusal) -> None:
        """Take the refusal, or failure, of a client's request that needs the motor."""
        if refusal.reason in _MOTOR_REASONS:
            self.missed = refusal

    def progress(self) -> Progress | None:
        """Return the progress of the running job."""
        return None if self.action is None else self.action.progress()

    def take_events(self) -> list[Event]:
        """Return what happened since the last call."""
        events, self.events = self.events, []
        return events

    def use_calibration(
        self,
        calibration: Calibration | None,
        problem: Refusal | None = None,
        file: str | None = None,
        by: int | None = None,
    ) -> None:
        """Use a calibration and its file, or the reason why there is none, from the next motion on.

        `by` is the client that has loaded it, None for the daemon itself.
        """
        self.calibrated.use(calibration, problem, file, by)
        if calibration is not None:
            doubts = self.calibrated.doubts(self.gripper_id, self.motor.identity)
            self.events.append(events.calibrated(calibration, file, doubts))

    def note_bus(self, bus: BusCondition) -> None:
        """Take the state of the bus; report each change of it once, whatever its errors say.

        The result of the first attempt to open the bus is reported as well, even if it is "down".
        """
        is_first = self.bus == NOT_OPENED and bus != NOT_OPENED
        if is_first or bus.state != self.bus.state:
            channel, is_missed = self.gripper_id.bus_channel, self.is_missed
            self.events.append(events.bus_changed(self.bus, bus, channel, is_missed=is_missed))
        self.bus = bus

    # Refusals

    def why_busy(self, turn: Turn = NOW) -> Refusal | None:
        """Return why no motion may begin, or None: the end, a stop, another sender or a motion."""
        refused = self.ending or self.stop_latch.refusal() or self.second_master.refusal()
        return refused or busy_refusal(self.in_the_way(turn))

    def travel(self, terms: Terms) -> Geometry | Refusal:
        """Return the travel of these terms if a motion in it is possible, otherwise a refusal."""
        geometry = terms.geometry
        if geometry is None:
            return self.calibrated.problem
        return motor_refusal(self.motor) or position_refusal(self.motor, geometry) or geometry

    def why_not_restartable(self) -> Refusal | None:
        """Return why no successor can take over now, or None.

        The reasons are the daemon's end, a motion, a disabling, and a recording that would be lost.
        """
        refusal = self.ending or busy_refusal(self.jobs.running)
        if refusal is None and (self.jobs.queue or self.must_disable):
            refusal = Refusal("busy", "a motion, or disabling the motor, is about to begin")
        if refusal is None and self.capture is not None and self.capture.would_be_lost:
            refusal = _recording("not kept yet")
        return refusal

    def recording_refusal(self) -> Refusal | None:
        """Return a refusal while a recording is under way: replay and teleoperation exclude it."""
        if self.capture is None or self.capture.is_over:
            return None
        return _recording("under way")

    # Jobs

    def begin(
        self,
        kind: JobKind,
        action: Action,
        owner: Owner,
        detached: bool,
        turn: Turn = NOW,
        *,
        terms: Terms | None = None,
    ) -> Job:
        """Begin a job on these terms; the caller has checked that it may begin at this turn."""
        self.end_replaced(turn)
        if kind not in _SAFE_JOBS:
            self.put_in_force(terms or self.terms)
        job = self._new_job(kind, owner, detached, turn)
        self.jobs.begin(job, self.now_s)
        self.action, self.has_stepped = action, False
        if action.needs_power:
            self._moved_by = kind
        self.events.append(events.job_started(job))
        return job

    def settle(
        self,
        kind: JobKind,
        idle: Idle,
        owner: Owner,
        result: Result,
        turn: Turn = NOW,
        *,
        terms: Terms | None = None,
    ) -> Job:
        """Change at once what idle jaws do; the job has ended when this returns.

        Slack jaws that are let go again, perhaps 50 times a second, are no news.
        """
        self.end_replaced(turn)
        is_news = not (isinstance(idle, Slack) and isinstance(self.idle, Slack))
        if isinstance(idle, Grip) and kind == "set_force":
            self._moved_by = kind
        self.put_in_force(terms or self.terms)
        self.idle = idle
        job = self._new_job(kind, owner, detached=True, turn=turn)
        self.jobs.begin(job, self.now_s)
        self.jobs.end(job, result, self.now_s)
        if is_news:
            self.events += [events.job_started(job), *events.job_ended(job, result, self.geometry)]
        else:
            self.jobs.forget_like(job)
        return job

    def cancel(self, number: int, by: Owner) -> Job | Refusal:
        """End a job; the jaws keep holding what they hold, else they hold where they are."""
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

    def end(self, outcome: Result | Refusal, *, by_defect: bool = False) -> None:
        """End the running job; its action decides what the jaws do then, else they hold.

        An action that failed `by_defect` does not decide: the jaws hold where they are.
        """
        job, action = self.jobs.running, self.action
        if job is None:
            self.action = None
            return
        self.jobs.end(job, outcome, self.now_s)
        if isinstance(outcome, Refusal):
            self.note_refused(outcome)
        elif isinstance(outcome, DisableResult):
            self.missed = None
        self.idle, self.action = self._left(by_defect=by_defect), None
        if action is not None and action.needs_power and self.has_stepped:
            self._ease_at_once()
        broken_off = job.kind == "enable" and isinstance(outcome, Refusal)
        if broken_off and self.motor.phase is not MotorPhase.ENABLED:
            self.must_disable = True  # it may still take effect
        owed, self._owed = self._owed, None
        if owed is not None:
            self._settle_into(owed)
        self.events += events.job_ended(job, outcome, self.geometry)
        if action is not None:
            action.close()

    def break_off(self, error: Exception) -> None:
        """End the running job in the tick in which a defect raised `error`.

        It would fail in every tick, and the motor would get no commands.
        """
        running = self.jobs.running
        if running is not None:
            self.must_disable = self.must_disable or running.kind == "disable"
            self.end(_defect(running, error), by_defect=True)

    def shut_down(self) -> None:
        """Begin the daemon's end: cancel what runs, disable the motor, and reject all else."""
        self.must_disable = True
        self._end(ENDING)

    def leave_to_successor(self) -> None:
        """Reject all from now on: the motor is another daemon's, and a lease lapses there."""
        self.lease.holder = None
        self._end(FOLLOWED)

    def _end(self, ending: Refusal) -> None:
        self.ending = ending
        self.end(ending)
        self._drop_queued(ending, lambda _job: True)

    def end_replaced(self, turn: Turn) -> None:
        """End the running motion if a request takes its place, which nothing refuses any more."""
        if turn.replaces is not None:
            self.end(turn.replaces)

    def put_in_force(self, terms: Terms) -> None:
        """Let these terms count for what the jaws do from now on.

        The configuration of a request is its motion's alone: what bounds all commands, and how hard
        a hold may press for long, is the daemon's.
        """
        self.in_force = replace(terms, config=self.config)

    def _left(self, *, by_defect: bool = False) -> Idle:
        """Return what the jaws would do if the running action ended now."""
        action, feedback = self.action, self.motor.feedback
        if action is None or feedback is None or not (action.needs_power and self.has_stepped):
            return self.idle
        idle = None if by_defect else action.idle_after()
        return idle or self.hold_here(feedback, self.in_force)

    def hold_here(self, feedback: Feedback, terms: Terms) -> Hold:
        """Return a hold for the jaws where they are; running ones are held where they can stop."""
        motor_type = self.gripper_id.motor_type
        return Hold.here(feedback, terms.gains, self.period_s, motor_type)

    def _ease_at_once(self) -> None:
        """Lower what a motion that has ended leaves pressing; a hold that presses nothing resists.

        A torque that the caller has set stays.
        """
        pressing_nm, idle = self.pressing.torque_nm, self.idle
        self._easing.reset()
        if pressing_nm is not None and isinstance(idle, Hold):
            self._easing.begin(pressing_nm, self._press_nm(idle))

    def _press_nm(self, hold: Hold) -> float:
        return self.in_force.config.stop_nm if hold.press_nm is None else hold.press_nm

    def _new_job(self, kind: JobKind, owner: Owner, detached: bool, turn: Turn) -> Job:
        """Return the queued job whose turn it is, or a new one, under the present lease."""
        job = turn.queued or self.jobs.add(kind, owner, detached, self.now_s)
        holder = self.lease.holder
        job.grant = None if holder is None else holder.number
        return job

    def _start_queued(self) -> None:
        """Start the queued motion whose turn it is; if it is rejected now, it ends with that."""
        while self.jobs.queue and self.jobs.running is None:
            entry = self.jobs.queue.popleft()
            job = entry.job
            try:
                refused = self.lease.refusal(job.owner) or entry.start(Turn(queued=job))
            except Exception as error:
                if job.state is JobState.QUEUED:
                    self._end_queued(job, _defect(job, error))
                raise
            if isinstance(refused, Refusal):
                self._end_queued(job, refused)

    def _drop_queued(self, refusal: Refusal, which: Callable[[Job], bool]) -> None:
        for job in self.jobs.take_queued(which):
            self._end_queued(job, refusal)

    def _end_queued(self, job: Job, refusal: Refusal) -> None:
        self.jobs.end(job, refusal, self.now_s)
        self.note_refused(refusal)
        self.events += events.job_ended(job, refusal, self.geometry)

    # The stop

    def stop(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> None:
        """Latch a stop, which takes effect with the next command.

        A stop that does not raise the level takes effect, too, but is only counted: many stops must
        not make as many events.
        """
        before = self.stop_latch.latched
        stop = self.stop_latch.raise_to(level, by, why, now_s)
        refusal = self.stop_latch.refusal()
        self._owed = None  # the choice of a lost client would undo the stop
        if refusal is not None:
            running = self.jobs.running
            if running is not None and running.kind != "disable":
                self.end(stopped_under_way(running, stop, refusal))
            self._drop_queued(refusal, lambda _job: True)
            if stop is not before:
                self.events.append(events.stopped(stop))
        self._settle_into(stop.level)
        if isinstance(self.idle, Grip):
            self.idle.freeze()  # no more torque than now, but nothing is dropped

    def clear_stop(self, by: Owner) -> None:
        """Allow motions again; the jaws stay as they are."""
        if self.stop_latch.latched is not None:
            self.events.append(events.stop_cleared(by, self.stop_latch.clear()))

    # The lease

    def acquire(self, owner: Owner, options: LeaseOptions) -> Grant | Refusal:
        """Grant the lease if it is free and no other client's motion runs, or is next."""
        before, in_the_way = self.lease.holder, self.in_the_way()
        if before is None and in_the_way is not None and in_the_way.owner.client != owner.client:
            return busy_with(in_the_way)
        answer = self.lease.acquire(owner, options, self.now_s)
        return self._granted(answer) if before is None else answer

    def release(self, owner: Owner) -> Refusal | None:
        """Release the lease; a motion that runs under it continues."""
        holder, running = self.lease.holder, self.jobs.running
        refusal = self.lease.release(owner)
        if refusal is None and holder is not None:
            self.events.append(events.lease_released(holder, owner))
            if running is not None and running.grant == holder.number:
                running.grant = None
        return refusal

    def take_over(
        self, owner: Owner, options: LeaseOptions, why: str, left: OnLost = "hold"
    ) -> tuple[Grant, list[Loss]]:
        """Take the lease from its holder; the caller has checked that `owner` may.

        All that runs ends, also another client's and a detached one. Only a disabling continues,
        and the taker's own motion without a lease. What others have queued never begins. Then the
        jaws do what the taker says (`left`), not what the loser or one before it said, unless
        something continues. Return the losses of those, other than the holder, whose motion ended.
        """
        self._leave_to_holder()
        before, holder = [job for job in self.jobs if job.is_running], self.lease.holder
        taken = events.taken_refusal(owner, why, left)
        grant, loss = self.lease.take(owner, options, why, left, self.now_s)
        running = self.jobs.running
        is_anothers = running is not None and running.owner.client != owner.client
        if running is not None and is_anothers and running.kind != "disable":
            self.end(taken)
        if loss is not None:
            self.lose(loss, loss.owner.client)
        elif self.jobs.running is None:
            self._settle_into(left)
        self._drop_queued(taken, lambda job: job.owner.client != owner.client)
        self._granted(grant)
        movers = {job.owner.client: job.owner for job in before if not job.is_running}
        if holder is not None:
            movers.pop(holder.owner.client, None)
        return grant, [Loss(mover, None, "taken", left, owner, why) for mover in movers.values()]

    def resume(self, number: int, owner: Owner) -> Grant | Refusal:
        """Grant a lapsed lease again after its client reconnected, if nobody has had one since.

        What still runs under the lapsed lease, runs under this one then; another client's motion
        must have ended.
        """
        in_the_way, running = self.in_the_way(), self.jobs.running
        if (
            self.lease.may_resume(number)
            and in_the_way is not None
            and in_the_way.owner.client != owner.client
            and in_the_way.grant != number
        ):
            return busy_with(in_the_way)
        answer = self._granted(self.lease.resume(number, owner, self.now_s))
        if isinstance(answer, Grant) and running is not None and running.grant == number:
            running.grant = answer.number
        return answer

    def _granted(self, answer: Grant | Refusal) -> Grant | Refusal:
        """Report a grant; from then on, what a lost client wanted for the jaws does not count."""
        if isinstance(answer, Grant):
            self._leave_to_holder()
            self.events.append(events.lease_granted(answer))
        return answer

    def _leave_to_holder(self) -> None:
        if self._owed is not None:
            self._owed = None
            self.events.append(events.left_to_holder())

    # Lost clients and lost leases

    def client_lost(self, client: int, cause: LossCause = "connection") -> None:
        """End what a client owned: its motions, unless detached, and its lease."""
        self.lose(self.lease.lose(client, cause), client)

    def lose(self, loss: Loss | None, client: int) -> None:
        """End the motion of a lost client or lease; then the jaws do what its options say.

        They do so at once, or after the end of a motion that continues: a detached one, or another
        client's. A disabling always continues. What the holder has queued under a lost lease never
        begins, detached or not: the lease's options say how the jaws are left. Nor does what a user
        of another machine has queued, with a lease or without.
        """
        running = self.jobs.running
        holder = None if loss is None else loss.owner.client
        self._drop_queued(
            events.loss_refusal(loss),
            lambda job: (
                job.owner.client == holder
                or _falls(job, loss, client)
                or (job.owner.client == client and job.owner.remote is not None)
            ),
        )
        ends = running is not None and running.kind != "disable" and _falls(running, loss, client)
        if running is not None and ends:
            self.end(events.loss_refusal(loss, is_owner=running.owner.client == client))
        on_lost: OnLost = "hold" if loss is None else loss.on_lost
        cause = None if loss is None else loss.cause
        later = loss is not None and self.jobs.running is not None
        if loss is not None:
            self.events.append(events.lease_lost(loss))
        if ends or loss is not None:
            self.events.append(events.client_lost(on_lost, cause, later=later))
        if later:
            self._owed = on_lost
        elif ends or loss is not None:
            self._settle_into(on_lost)

    def _step_authority(self, now_s: float) -> None:
        """Advance the authority: a lease that expires, and the next motion in the queue.

        A motion under a lease that is not the present one never continues; a disabling always does.
        """
        loss = self.lease.expire(now_s)
        if loss is not None:
            self.lose(loss, loss.owner.client)
        running, holder = self.jobs.running, self.lease.holder
        present = None if holder is None else holder.number
        if (
            running is not None
            and not running.detached
            and running.kind != "disable"
            and running.grant not in (None, present)
        ):
            self.end(events.loss_refusal(None))
        self._start_queued()
        self.lease.step(now_s, may_grant=self.jobs.running is None)
        granted = self.lease.holder
        if granted is not None and granted is not holder:
            self._granted(granted)

    def _settle_into(self, level: StopLevel) -> None:
        """Do what a stop or a lost client leaves behind; a hold is kept, with its force."""
        if level == "disable" or (level == "relax" and self.motor.phase is MotorPhase.SILENT):
            self.must_disable = True  # a motor that does not answer can only be disabled
        elif level == "relax":
            self.idle = Slack()
        elif isinstance(self.idle, Grip):
            self.idle.stay()

    # The tick

    def step(self, now_s: float, motor: MotorView) -> MotorInput:
        """Return the input of the motor for this tick.

        The order of decisions is: power, fault, stop, lost client, the action, the idle jaws.
        """
        motor = _finite(motor)
        self._note_phase(motor)
        self._note_zero(motor.zero)
        self._note_ranges(motor)
        self.ticks += 1
        self.now_s = now_s
        self._step_authority(now_s)
        self._note_second_master(now_s, motor)
        self._note_made_torque(motor)
        if self.capture is not None:
            self.capture.step(now_s, motor, self.geometry, self.grip, self.jobs)
        register = self.register_reads.step(motor.register)
        if self.must_disable:
            self.must_disable = False
            self._send_nothing(now_s)
            return self._asked(MotorInput(request=DisableMotor(), register=register))
        command, request = self._act(now_s)
        feedback = motor.feedback
        if motor.phase is not MotorPhase.ENABLED or feedback is None:
            self._send_nothing(now_s)
            self._note_release(now_s, motor)
            return self._asked(MotorInput(request=request, register=register))
        is_motion = command is not None
        command = command or self._idle_command(now_s, feedback)
        command = self._calmed(command, feedback, is_motion=is_motion)
        self._note_contact(now_s, feedback)
        sent = self._send(now_s, command, feedback)
        return self._asked(MotorInput(sent, request, is_motion, register))

    def _asked(self, wanted: MotorInput) -> MotorInput:
        """Note that the motor is asked to let go: what is released then is released by wish."""
        if isinstance(wanted.request, DisableMotor):
            self._asked_off, self._held = True, None
        return wanted

    def _act(self, now_s: float) -> tuple[MitCommand | None, MotorRequest | None]:
        """Step the running action, if the motor is still enabled."""
        action, motor = self.action, self.motor
        if action is None:
            return None, None
        if action.needs_power and motor.phase is not MotorPhase.ENABLED:
            self.end(motor_refusal(motor) or NOT_ENABLED)
            return None, None
        self.has_stepped = True
        step = action.step(now_s, motor)
        if step.task is not None:
            self.tasks.append(step.task)
        if step.adopted is not None:
            running = self.jobs.running
            by = None if running is None else running.owner.client
            self.use_calibration(step.adopted.calibration, file=step.adopted.file, by=by)
            self.put_in_force(self.terms)
        if step.outcome is not None:
            self.end(step.outcome)
        return step.command, step.request

    def _idle_command(self, now_s: float, feedback: Feedback) -> MitCommand:
        idle, geometry = self.idle, self.in_force.geometry
        if isinstance(idle, Hold) and geometry is not None:
            self.idle = idle = idle.eased(feedback.position_rad, geometry)
        if isinstance(idle, Hold):
            calm = replace(idle, gains=self.swing.bound(idle.gains))
            most_nm = self._easing.step(
                now_s,
                calm.asked_nm(feedback.position_rad),
                self._press_nm(calm),
                feedback.torque_nm,
                stands=True,  # a hand that moves them to and fro presses, too
            )
            idle = calm.within(most_nm, feedback.position_rad)
        command = idle.command(now_s, feedback)
        if isinstance(idle, Grip) and idle.is_lost:
            if idle.watched:
                self.events.append(events.object_lost(None, is_doubtful=idle.is_doubtful))
            caught_rad = idle.caught_rad(feedback.position_rad, self.period_s)
            self.idle = Hold(caught_rad, self.swing.bound(CATCHING_GAINS))
            return self.idle.command(now_s, feedback)
        return command

    def _note_contact(self, now_s: float, feedback: Feedback) -> None:
        """Report a held object that has moved, and jaws that press unasked for as a grasp."""
        grip, running, geometry = self.grip, self.jobs.running, self.in_force.geometry
        is_held = grip is not None and grip.is_holding
        moved_mm = None if grip is None else grip.take_moved_mm()
        if grip is not None and is_held and moved_mm is not None:
            width_mm = grip.geometry.opening_mm(feedback.position_rad)
            self.events.append(events.object_moved(moved_mm, width_mm))
        self.pressing.see(feedback, is_held=is_held)
        if geometry is not None:
            self.way.see(feedback, geometry.close_sign)
        if is_held or self._is_pushed or geometry is None:
            return
        if running is not None and running.kind == "zero":
            return  # it looks for the stops by pressing, and judges itself what it has found
        config, stops_rad = self.in_force.config, (geometry.closed_rad, geometry.open_rad)
        short_rad = min(abs(feedback.position_rad - stop_rad) for stop_rad in stops_rad)
        if short_rad <= config.stop_tol and abs(feedback.torque_nm) <= config.stop_nm:
            return  # a stop is elastic, and pushes back a little
        lasting = self.pressing.take_lasting(now_s, self._moved_by)
        if lasting is not None:
            self.events.append(events.pressing(lasting, geometry, self._moved_by, running))

    def _calmed(self, command: MitCommand, feedback: Feedback, *, is_motion: bool) -> MitCommand:
        """Return a command that does not swing: of a hold by stiffness, or of a follower."""
        running = self.jobs.running
        is_led = running is not None and running.kind == "teleop"
        if command.kp_nm_rad == 0.0 or (is_motion and not is_led):
            self.swing.rest()
            return command
        command, is_lowered = self.swing.calm(command, feedback)
        if is_lowered:
            self.events.append(events.swings(self.swing.share))
        return command

    def _send(self, now_s: float, command: MitCommand, feedback: Feedback) -> MitCommand | None:
        """Return the command that is sent in place of `command`."""
        identity, action = self.motor.identity, self.action
        ranges = self.gripper_id.motor_type.ranges if identity is None else identity.ranges
        own_bounds = None if action is None else action.bounds
        bounds = own_bounds or bounds_of(self.in_force.geometry, self.in_force.config)
        grip = self.grip
        change = self.output.send(
            now_s,
            command,
            feedback,
            bounds,
            ranges,
            grips=grip is not None or self._is_pushed,
            is_held_back=action is not None and action.is_held_back,
        )
        if change is not None:
            self.events.append(events.heat_changed(change))
        if grip is not None:
            self._foretell_heat(now_s, grip)
        sent = self.output.command
        if grip is not None and sent is not None:
            grip.note_sent(sent.torque_nm)
        return sent

    def _foretell_heat(self, now_s: float, grip: Grip) -> None:
        """Report that the coil does not bear the force of a hold for ever: once in a while."""
        heat, torque_nm = self.output.heat, grip.geometry.torque_nm(grip.force_n)
        if now_s - self._foretold_s >= FORETELL_EVERY_S:
            self._foretold_n = 0.0
        if not heat.lasting_nm < torque_nm or grip.force_n <= FORETELL_MORE * self._foretold_n:
            return
        bears_s = heat.bears_s(torque_nm)
        if bears_s is not None:
            self._foretold_n, self._foretold_s = grip.force_n, now_s
            self.events.append(events.heat_foretold(grip.force_n, bears_s, heat))

    def _send_nothing(self, now_s: float) -> None:
        self.pressing.reset()
        self.way.reset()
        change = self.output.unpowered(now_s, self.motor.feedback)
        if change is not None:
            self.events.append(events.heat_changed(change))

    def _note_zero(self, zero: ZeroView) -> None:
        useless = self.calibrated.note_zero(zero)
        if useless is not None:
            self.put_in_force(self.terms)
            content = content_of(useless, self.gripper_id, self.gains, self.motor)
            self.tasks.append(save_task(self.gripper_id, content, self._saved))
            self.events.append(events.calibrated(useless, self.calibrated.file, ()))
            if self.action is not None and self.action.needs_power:
                self.end(ZERO_MOVED)  # its travel is no longer known

    def _note_ranges(self, motor: MotorView) -> None:
        """Give up a calibration beyond what the motor, as soon as it is known, can report."""
        ranges = None if motor.identity is None else motor.identity.ranges
        if ranges is None or ranges == self._ranges:
            return
        self._ranges = ranges
        refusal = self.calibrated.leave_range(ranges.position_rad)
        if refusal is not None:
            self.put_in_force(self.terms)
            self.events.append(Event("calibration", refusal.message, {"error": refusal.reason}))
            if self.action is not None and self.action.needs_power:
                self.end(refusal)

    def _saved(self, result: TaskResult) -> None:
        if result.error is not None:
            self.events.append(events.not_saved(result.error))

    def _note_second_master(self, now_s: float, motor: MotorView) -> None:
        """End what runs when another program commands the motor; the jaws keep holding."""
        event = self.second_master.step(now_s, motor.foreign_commands, motor.foreign_write)
        if event is not None:
            self.events.append(event)
        refusal, running = self.second_master.refusal(), self.jobs.running
        if refusal is not None and running is not None and running.kind not in _SAFE_JOBS:
            self.end(refusal)

    def _note_made_torque(self, motor: MotorView) -> None:
        """Report a motor that makes less torque than is commanded, and the end of that."""
        made = self.output.made
        if motor.feedback is None or motor.phase is not MotorPhase.ENABLED:
            return
        if self.second_master.is_active:
            made.reset()  # it may obey other commands
        elif made.see(motor.feedback, self.output.command):
            self.events.append(events.weak(made))
        self.motor = self.motor._replace(is_short=made.is_short)
        if self.grip is not None:
            made_nm = made.made_nm if made.is_judging or made.is_weak else None
            self.grip.note_made(motor.feedback.at_s, made_nm, is_short=made.is_short)

    def _note_phase(self, motor: MotorView) -> None:
        """Hold what is measured now when the motor becomes enabled, or answers again.

        Jaws that were slack before a silence stay slack: a hand may be in them. A hold by force
        continues, or it would drop its object: a motor that reports that it is still enabled has
        kept squeezing. So does a hold with which the jaws are where it leaves them; its gains stay
        in any case.
        """
        self.events += events.motor_changed(self.motor, motor)
        if motor.phase is not self.motor.phase:
            self._note_held(motor.phase)
        before, self.motor = self.motor.phase, motor
        if motor.phase in _POWERED:
            self._is_powered = True
        elif motor.phase in _OFF:
            self._is_powered = False
        if motor.phase is MotorPhase.ENABLED or (
            motor.phase is MotorPhase.DISABLED and motor.latched is None and motor.problem is None
        ):
            self.missed = None
        if motor.phase is before:
            return
        if motor.phase is not MotorPhase.ENABLED or motor.feedback is None:
            return
        idle, here_rad = self.idle, motor.feedback.position_rad
        if before is not MotorPhase.SILENT:
            self.put_in_force(self.terms)
            self.swing.renew()
            self.idle, self._moved_by = Hold(here_rad, self.gains), "enable"
        elif isinstance(idle, Grip):
            idle.resume()
        elif isinstance(idle, Hold) and not idle.presses(motor.feedback):
            self.idle = replace(idle, position_rad=here_rad)

    def _note_held(self, phase: MotorPhase) -> None:
        """Remember what an enabled motor holds by force when it stops being enabled by itself."""
        last, grip = self.motor.feedback, self.grip
        if phase is MotorPhase.ENABLED:
            self._asked_off, self._held = False, None
        elif self.motor.phase is not MotorPhase.ENABLED or self._asked_off or last is None:
            return
        elif grip is not None and grip.is_holding:
            width_mm = grip.geometry.opening_mm(last.position_rad)
            self._held = events.HeldObject(grip.force_n, width_mm, last.at_s)

    def _note_release(self, now_s: float, motor: MotorView) -> None:
        """Report a held object that is no longer held, and end the hold of a motor that is off."""
        held, is_silent = self._held, motor.phase is MotorPhase.SILENT
        if held is not None and not (is_silent and now_s - held.since_s < RELEASES_WITHIN_S):
            self.events.append(events.released_by_fault(held, motor))
            self._held = None
        if isinstance(self.idle, Grip) and not is_silent and motor.phase is not MotorPhase.ENABLED:
            at = motor.feedback
            self.idle = Slack() if at is None else Hold(at.position_rad, self.in_force.gains)


def _defect(job: Job, error: Exception) -> Refusal:
    text = f"{job.kind} failed by a defect: {type(error).__name__}: {error}"
    return Refusal("internal_error", text)


def _falls(job: Job, loss: Loss | None, client: int) -> bool:
    """Return True if a job ends with its client, or with the lease that it runs under."""
    if job.detached:
        return False
    under = loss is not None and job.grant == loss.grant
    return under or job.owner.client == client


def _finite(motor: MotorView) -> MotorView:
    """Drop a measurement that is no number: nothing may be derived from it."""
    feedback = motor.feedback
    if feedback is None:
        return motor
    total = feedback.position_rad + feedback.velocity_rad_s + feedback.torque_nm
    return motor if math.isfinite(total) else motor._replace(feedback=None)


def _recording(how: str) -> Refusal:
    """Return why a recording is in the way."""
    text = sentence("a recording is {how}: end it ({trajectory.record_stop})", how=how)
    return Refusal("trajectory_busy", text, {"hint": method_name("trajectory.record_stop")})
