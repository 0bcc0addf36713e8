"""The engine: the one place that decides, in every tick, what the motor is told.

Pure: `step(now_s, motor)` returns the order for this tick. Between ticks clients ask for motions
(`Motions` and `Calibrating` begin them), for a stop, or are lost; nothing of that reaches the
motor but through `step`.
"""

from litegripd.control import announce
from litegripd.control.actions.base import Action
from litegripd.control.admission import (
    ENDING,
    NOT_ENABLED,
    busy_refusal,
    motor_refusal,
)
from litegripd.control.filter import bounds_of
from litegripd.control.gains import Gains
from litegripd.control.grip import Grip
from litegripd.control.in_use import CalibrationInUse
from litegripd.control.inquiries import Inquiries
from litegripd.control.jobs import JobBook
from litegripd.control.keeping import Keeping
from litegripd.control.output import Output
from litegripd.control.rest import Hold, Relax, Rest
from litegripd.control.saving import save_errand
from litegripd.control.stop import StopLatch
from litegripd.model.calibration import Calibration
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.events import Event
from litegripd.model.geometry import Geometry
from litegripd.model.jobs import Job, JobKind, OnLost, Owner, StopLevel
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import (
    DisableMotor,
    Feedback,
    MitCommand,
    MotorOrder,
    MotorPhase,
    MotorRequest,
    MotorView,
    Ranges,
    ZeroView,
)
from litegripd.model.results import EnableResult, Progress, Result
from litegripd.model.unit import Unit


class Engine:
    """Runs one gripper: at most one job, else a rest that holds the jaws or lets them go."""

    def __init__(self, config: MotionConfig, period_s: float, unit: Unit | None = None) -> None:
        self.config = config
        self.config_is_kept = False
        self.period_s = period_s
        self.unit = unit or Unit()
        self.jobs = JobBook()
        self.stop_latch = StopLatch()
        self.calibrated = CalibrationInUse()
        self.motor = MotorView(MotorPhase.UNKNOWN)
        self.ticks = 0
        self.now_s = 0.0
        self.output = Output()
        self.rest: Rest = Relax()
        self.keeping = Keeping()
        self.inquiries = Inquiries()
        self.errands: list[Errand] = []
        self.action: Action | None = None
        self._must_disable = False
        self._is_ending = False
        self._events: list[Event] = []

    @property
    def geometry(self) -> Geometry | None:
        """The calibrated travel, None while uncalibrated."""
        return self.calibrated.geometry

    @property
    def gains(self) -> Gains:
        """The gains of holds and moves: the calibration's, else the default."""
        return self.calibrated.gains

    @property
    def grip(self) -> Grip | None:
        """The hold by force, if there is one, be it a grasp's or what one has left."""
        rest = self.rest if self.action is None else self.action.rest()
        return rest if isinstance(rest, Grip) else None

    def use_calibration(
        self,
        calibration: Calibration | None,
        problem: Refusal | None = None,
        file: str | None = None,
    ) -> None:
        """Take a calibration and its file, or the reason why there is none."""
        self.calibrated.use(calibration, problem, file)
        if calibration is not None:
            self._events.append(announce.calibrated(calibration, file))

    # What clients ask for, between two ticks

    def unfree(self) -> Refusal | None:
        """Say why no motion may be asked for: the daemon's end, a stop, or another motion."""
        ending = ENDING if self._is_ending else None
        return ending or self.stop_latch.refusal() or busy_refusal(self.jobs.running)

    def begin(self, kind: JobKind, action: Action, owner: Owner, detached: bool) -> Job:
        """Begin a job; the caller has made sure that it may."""
        job = self.jobs.begin(kind, owner, detached, self.now_s)
        self.action = action
        self._events.append(announce.job_started(job))
        return job

    def settle(self, kind: JobKind, rest: Rest, owner: Owner, result: Result) -> Job:
        """Change at once what the jaws do without a motion; the job has ended when it returns."""
        self.rest = rest
        job = self.jobs.begin(kind, owner, True, self.now_s)
        self.end(result)
        return job

    def end(self, outcome: Result | Refusal) -> None:
        """End the running job; what the jaws do then is its action's to say, else they hold."""
        action, self.action = self.action, None
        job = self.jobs.end(outcome, self.now_s)
        if job is None:
            return
        feedback = self.motor.feedback
        if action is not None and action.needs_power and feedback is not None:
            self.rest = action.rest() or Hold(feedback.position_rad, self.gains)
        broken_off = job.kind == "enable" and isinstance(outcome, Refusal)
        if broken_off and self.motor.phase is not MotorPhase.ENABLED:
            self._must_disable = True  # it may still take effect
        if job.kind == "enable":
            self.keeping.decide(isinstance(outcome, EnableResult) and outcome.ok)
        owed = self.keeping.take_owed()
        if owed is not None:
            self._settle_into(owed)
        self._events += announce.job_ended(job, outcome)

    def cancel(self, number: int, by: Owner) -> Job | Refusal:
        """End a running job; the jaws go on holding what they hold, else where they are."""
        job = self.jobs.get(number)
        if job is None:
            return Refusal("unknown_job", f"there is no job {number}, or it is no longer kept")
        if job is self.jobs.running:
            who = f"{by.program} (pid {by.pid})"
            self.end(Refusal("cancelled", f"cancelled by {who}", {"by": who}))
        return job

    def stop(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> None:
        """Stop, in force with the next command that is sent, and latched."""
        stop = self.stop_latch.raise_to(level, by, why, now_s)
        refusal = self.stop_latch.refusal()
        if refusal is not None:
            running = self.jobs.running
            if running is not None and running.kind != "disable":
                self.end(refusal)
            self._events.append(announce.stopped(stop.level, refusal))
        self._settle_into(stop.level)
        if isinstance(self.rest, Grip):
            self.rest.freeze()  # no more torque than there is now, but not a dropped object either

    def clear_stop(self, by: Owner) -> None:
        """Allow motions again; the jaws stay as they are."""
        if self.stop_latch.latched is not None:
            self.stop_latch.clear()
            self._events.append(announce.stop_cleared(by))

    def client_lost(self, client: int) -> None:
        """End what a client owned: its motion, unless detached, and its keeping of the motor.

        What a lost keeper wanted of the jaws is done at once, or when the motion has ended that
        goes on without it: a detached one, or another client's. Disabling always goes on.
        """
        running = self.jobs.running
        owned = running is not None and running.owner.client == client and not running.detached
        ends = owned and running is not None and running.kind != "disable"
        wanted = self.keeping.lose(client, outlived=running is not None and not ends)
        on_lost: OnLost = wanted or "hold"
        if running is not None and ends:
            text = f"the client that owned it, {running.owner.program}, went away"
            self.end(Refusal("client_lost", text, {"on_lost": on_lost}))
        if ends or wanted is not None:
            later = self.keeping.is_owed
            self._events.append(announce.client_lost(on_lost, later=later))
            if not later:
                self._settle_into(on_lost)

    def shut_down(self) -> None:
        """Begin the daemon's end: what runs is cancelled, the motor disabled, all else refused."""
        self._is_ending = True
        self.end(ENDING)
        self._must_disable = True

    # The tick

    def step(self, now_s: float, motor: MotorView) -> MotorOrder:
        """Decide. In this order: power, fault, stop, lost client, the action, the rest."""
        self._note_phase(motor)
        self._note_zero(motor.zero)
        self.ticks += 1
        self.now_s = now_s
        inquiry = self.inquiries.step(motor.register)
        if self._must_disable:
            self._must_disable = False
            self._send_nothing(now_s)
            return MotorOrder(request=DisableMotor(), register=inquiry)
        command, request = self._act(now_s)
        feedback = motor.feedback
        if motor.phase is not MotorPhase.ENABLED or feedback is None:
            self._send_nothing(now_s)
            return MotorOrder(request=request, register=inquiry)
        is_motion = command is not None
        command = command or self._rest_command(now_s, feedback)
        return MotorOrder(self._send(now_s, command, feedback), request, is_motion, inquiry)

    def progress(self) -> Progress | None:
        """Tell where the running job is."""
        return None if self.action is None else self.action.progress()

    def take_events(self) -> list[Event]:
        """Return what happened since the last call."""
        events, self._events = self._events, []
        return events

    def _act(self, now_s: float) -> tuple[MitCommand | None, MotorRequest | None]:
        """Step the running action, if its motor is still there."""
        action, motor = self.action, self.motor
        if action is None:
            return None, None
        if action.needs_power and motor.phase is not MotorPhase.ENABLED:
            self.end(motor_refusal(motor) or NOT_ENABLED)
            return None, None
        step = action.step(now_s, motor)
        if step.errand is not None:
            self.errands.append(step.errand)
        if step.adopted is not None:
            self.use_calibration(step.adopted.calibration, file=step.adopted.file)
        if step.outcome is not None:
            self.end(step.outcome)
        return step.command, step.request

    def _rest_command(self, now_s: float, feedback: Feedback) -> MitCommand:
        rest = self.rest
        command = rest.command(now_s, feedback)
        if isinstance(rest, Grip) and rest.is_lost:
            self._events.append(announce.object_lost(None))
            self.rest = Hold(feedback.position_rad, self.gains)
            return self.rest.command(now_s, feedback)
        return command

    def _send(self, now_s: float, command: MitCommand, feedback: Feedback) -> MitCommand | None:
        """Return what is sent in place of `command`."""
        identity, action = self.motor.identity, self.action
        ranges = Ranges() if identity is None else identity.ranges
        own_bounds = None if action is None else action.bounds
        bounds = own_bounds or bounds_of(self.geometry, self.config)
        change = self.output.send(now_s, command, feedback, bounds, ranges)
        if change is not None:
            self._events.append(announce.heat_changed(change))
        return self.output.command

    def _send_nothing(self, now_s: float) -> None:
        change = self.output.unpowered(now_s, self.motor.feedback)
        if change is not None:
            self._events.append(announce.heat_changed(change))

    def _note_zero(self, zero: ZeroView) -> None:
        useless = self.calibrated.note_zero(zero)
        if useless is not None:
            errand = save_errand(useless, self.unit, self.gains, self.motor, self._saved)
            self.errands.append(errand)
            self._events.append(announce.calibrated(useless, self.calibrated.file))

    def _saved(self, result: ErrandResult) -> None:
        if result.error is not None:
            self._events.append(announce.not_saved(result.error))

    def _note_phase(self, motor: MotorView) -> None:
        """Whenever the motor becomes enabled, or answers again, hold what is measured now.

        Jaws that were slack before a silence stay slack: a hand may be in them.
        """
        before, self.motor = self.motor.phase, motor
        if motor.phase is before:
            return
        self._events.append(announce.motor_changed(before, motor.phase))
        slack = before is MotorPhase.SILENT and isinstance(self.rest, Relax)
        if motor.phase is MotorPhase.ENABLED and motor.feedback is not None and not slack:
            self.rest = Hold(motor.feedback.position_rad, self.gains)

    def _settle_into(self, level: StopLevel) -> None:
        """Go into what a stop or a lost client leaves behind; a hold is kept, force included."""
        if level == "disable" or (level == "relax" and self.motor.phase is MotorPhase.SILENT):
            self._must_disable = True  # a motor that does not answer can only be told to let go
        elif level == "relax":
            self.rest = Relax()
