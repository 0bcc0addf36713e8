"""The engine: the one place that decides, in every tick, what the motor is told.

Pure: `step(now_s, motor)` returns the order for this tick. Between ticks clients ask for motions
(`start`), for a stop, or are lost; nothing of that reaches the motor but through `step`.
"""

from litegripd.control import announce
from litegripd.control.actions.base import DEFAULT_GAINS, Action, gains_of
from litegripd.control.actions.move_to_stop import Direction, MoveToStop
from litegripd.control.actions.power import Disable, Enable
from litegripd.control.admission import (
    ENDING,
    NO_FEEDBACK,
    NOT_CALIBRATED,
    NOT_ENABLED,
    busy_refusal,
    motor_refusal,
    position_refusal,
    speed_refusal,
)
from litegripd.control.filter import LastWord, bounds_of
from litegripd.control.jobs import JobBook
from litegripd.control.keeping import Keeping
from litegripd.control.rest import Hold, Relax, Rest
from litegripd.control.stop import StopLatch
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.events import Event
from litegripd.model.geometry import Geometry
from litegripd.model.jobs import Job, JobKind, OnLost, Owner, StopLevel
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import (
    DisableMotor,
    EnableMotor,
    MitCommand,
    MotorOrder,
    MotorPhase,
    MotorView,
    Ranges,
)
from litegripd.model.results import EnableResult, HoldResult, Progress, Result


class Engine:
    """Runs one gripper: at most one job, else a rest that holds the jaws or lets them go."""

    def __init__(self, config: MotionConfig, period_s: float) -> None:
        self.config = config
        self.jobs = JobBook()
        self.stop_latch = StopLatch()
        self.calibration: Calibration | None = None
        self.gains = DEFAULT_GAINS
        self.motor = MotorView(MotorPhase.UNKNOWN)
        self.ticks = 0
        self.now_s = 0.0
        self.command: MitCommand | None = None
        self.limited: tuple[str, ...] = ()
        self.rest: Rest = Relax()
        self.calibration_problem: Refusal | None = None
        self._period_s = period_s
        self._action: Action | None = None
        self.keeping = Keeping()
        self._last_word = LastWord()
        self._must_disable = False
        self._is_ending = False
        self._events: list[Event] = []

    @property
    def geometry(self) -> Geometry | None:
        """The calibrated travel, None while uncalibrated."""
        calibration = self.calibration
        return calibration.geometry if calibration and calibration.calibrated else None

    def use_calibration(self, calibration: Calibration | None, problem: Refusal | None) -> None:
        """Take a calibration, or the reason why there is none; never while a motion runs."""
        self.calibration = calibration
        self.calibration_problem = problem
        if calibration is not None:
            self.gains = gains_of(calibration)

    # What clients ask for, between two ticks ---------------------------------------------------

    def enable(
        self, owner: Owner, tries: int | None, detached: bool, on_lost: OnLost
    ) -> Job | Refusal:
        """Begin to enable the motor; `owner` becomes its keeper."""
        refusal = self._unfree() or self.motor.problem
        if refusal is not None:
            return refusal
        tries = tries or self.config.enable_retries
        request = EnableMotor(tries, self.config.enable_retry_interval)
        self.keeping.propose(owner.client, on_lost)
        return self._begin("enable", Enable(request), owner, detached)

    def disable(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to disable the motor; ends the owner's own motion, but not another's."""
        running = self.jobs.running
        if running is not None and running.owner.client == owner.client:
            self._end(Refusal("cancelled", "ended by motor.disable of the same client"))
        refusal = busy_refusal(self.jobs.running)
        if refusal is not None:
            return refusal
        self.keeping.end()
        return self._begin("disable", Disable(), owner, detached)

    def move(
        self, direction: Direction, owner: Owner, speed_mm_s: float | None, detached: bool
    ) -> Job | Refusal:
        """Begin to open or close at `speed_mm_s` (the configured speed by default)."""
        refusal = self._unfree()
        if refusal is not None:
            return refusal
        geometry = self.geometry
        if geometry is None:
            return self.calibration_problem or NOT_CALIBRATED
        speed = self.config.speed_mm_s if speed_mm_s is None else speed_mm_s
        refusal = (
            speed_refusal(self.config, speed, geometry, self._period_s)
            or motor_refusal(self.motor)
            or position_refusal(self.motor, geometry)
        )
        if refusal is not None:
            return refusal
        action = MoveToStop(
            direction,
            speed,
            geometry=geometry,
            config=self.config,
            gains=self.gains,
            period_s=self._period_s,
        )
        return self._begin(direction, action, owner, detached)

    def hold(self, owner: Owner) -> Job | Refusal:
        """Hold from now on: what is held already, else the measured position."""
        refusal = self._unfree() or motor_refusal(self.motor)
        feedback = self.motor.feedback
        if refusal is not None or feedback is None:
            return refusal or NO_FEEDBACK
        if not isinstance(self.rest, Hold):  # holding anew would lose the force of the hold
            self.rest = Hold(feedback.position_rad, self.gains)
        job = self.jobs.begin("hold", owner, True, self.now_s)
        self._end(HoldResult(self.rest.position_rad))
        return job

    def cancel(self, number: int, by: Owner) -> Job | Refusal:
        """End a running job; the jaws hold where they are."""
        job = self.jobs.get(number)
        if job is None:
            return Refusal("unknown_job", f"there is no job {number}, or it is no longer kept")
        if job is self.jobs.running:
            who = f"{by.program} (pid {by.pid})"
            self._end(Refusal("cancelled", f"cancelled by {who}", {"by": who}))
        return job

    def stop(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> None:
        """Stop, in force with the next command that is sent, and latched."""
        stop = self.stop_latch.raise_to(level, by, why, now_s)
        refusal = self.stop_latch.refusal()
        if refusal is not None:
            running = self.jobs.running
            if running is not None and running.kind != "disable":
                self._end(refusal)
            self._events.append(announce.stopped(stop.level, refusal))
        self._settle_into(stop.level)

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
            self._end(Refusal("client_lost", text, {"on_lost": on_lost}))
        if ends or wanted is not None:
            later = self.keeping.is_owed
            self._events.append(announce.client_lost(on_lost, later=later))
            if not later:
                self._settle_into(on_lost)

    def shut_down(self) -> None:
        """Begin the daemon's end: what runs is cancelled, the motor disabled, all else refused."""
        self._is_ending = True
        self._end(ENDING)
        self._must_disable = True

    # The tick ---------------------------------------------------------------------------------

    def step(self, now_s: float, motor: MotorView) -> MotorOrder:
        """Decide. In this order: power, fault, stop, lost client, the action, the rest."""
        self._note_phase(motor)
        self.ticks += 1
        self.now_s = now_s
        if self._must_disable:
            self._must_disable = False
            self._go_unpowered(now_s)
            return MotorOrder(request=DisableMotor())
        command, request = self._act(now_s)
        feedback = motor.feedback
        if motor.phase is not MotorPhase.ENABLED or feedback is None:
            self._go_unpowered(now_s)
            return MotorOrder(request=request)
        is_motion = command is not None
        command = command or self.rest.command(feedback)
        ranges = Ranges() if motor.identity is None else motor.identity.ranges
        bounds = bounds_of(self.geometry, self.config)
        self.command, self.limited = self._last_word.apply(now_s, command, feedback, bounds, ranges)
        return MotorOrder(self.command, request, is_motion)

    def progress(self) -> Progress | None:
        """Tell where the running job is."""
        return None if self._action is None else self._action.progress()

    def take_events(self) -> list[Event]:
        """Return what happened since the last call."""
        events, self._events = self._events, []
        return events

    def _act(self, now_s: float) -> tuple[MitCommand | None, EnableMotor | DisableMotor | None]:
        """Step the running action, if its motor is still there."""
        action, motor = self._action, self.motor
        if action is None:
            return None, None
        if action.needs_power and motor.phase is not MotorPhase.ENABLED:
            self._end(motor_refusal(motor) or NOT_ENABLED)
            return None, None
        step = action.step(now_s, motor)
        if step.outcome is not None:
            self._end(step.outcome)
        return step.command, step.request

    def _go_unpowered(self, now_s: float) -> None:
        self.command, self.limited = None, ()
        self._last_word.unpowered(now_s)

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

    def _begin(self, kind: JobKind, action: Action, owner: Owner, detached: bool) -> Job:
        job = self.jobs.begin(kind, owner, detached, self.now_s)
        self._action = action
        self._events.append(announce.job_started(job))
        return job

    def _end(self, outcome: Result | Refusal) -> None:
        """End the running job; from a motion the jaws go over into holding where they are."""
        action, self._action = self._action, None
        job = self.jobs.end(outcome, self.now_s)
        if job is None:
            return
        feedback = self.motor.feedback
        if action is not None and action.needs_power and feedback is not None:
            self.rest = Hold(feedback.position_rad, self.gains)
        broken_off = job.kind == "enable" and isinstance(outcome, Refusal)
        if broken_off and self.motor.phase is not MotorPhase.ENABLED:
            self._must_disable = True  # it may still take effect
        if job.kind == "enable":
            self.keeping.decide(isinstance(outcome, EnableResult) and outcome.ok)
        owed = self.keeping.take_owed()
        if owed is not None:
            self._settle_into(owed)
        self._events.append(announce.job_ended(job, outcome))

    def _unfree(self) -> Refusal | None:
        """Say why no motion may be asked for: the daemon's end, a stop, or another motion."""
        ending = ENDING if self._is_ending else None
        return ending or self.stop_latch.refusal() or busy_refusal(self.jobs.running)

    def _settle_into(self, level: StopLevel) -> None:
        """Go into what a stop or a lost client leaves behind; a hold is kept, force included."""
        if level == "disable" or (level == "relax" and self.motor.phase is MotorPhase.SILENT):
            self._must_disable = True  # a motor that does not answer can only be told to let go
        elif level == "relax":
            self.rest = Relax()
