"""The engine: the one place that decides, in every tick, what the motor is told.

Pure: `step(now_s, motor)` returns the order for this tick. Between ticks clients ask for motions
(`Motions` and `Calibrating` begin them), for a stop, or are lost; nothing of that reaches the
motor but through `step`.
"""

import math
from dataclasses import replace

from litegripd.control import announce
from litegripd.control.admission import (
    NOT_ENABLED,
    ZERO_MOVED,
    motor_refusal,
)
from litegripd.control.arbiter import Arbiter
from litegripd.control.capture import Capture
from litegripd.control.filter import bounds_of
from litegripd.control.gains import Gains
from litegripd.control.grip import Grip
from litegripd.control.inquiries import Inquiries
from litegripd.control.output import Output
from litegripd.control.rest import Hold, Relax
from litegripd.control.saving import content_of, save_errand
from litegripd.model.bus import NOT_OPENED, BusCondition
from litegripd.model.calibration import Calibration
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.events import Event
from litegripd.model.geometry import Geometry
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
from litegripd.model.results import Progress
from litegripd.model.unit import Unit

_SAFE_JOBS = ("disable", "clear_fault")
"""What goes on though another program commands the motor: it energises nothing."""


class Engine(Arbiter):
    """Runs one gripper: what the arbiter lets run, step by step."""

    def __init__(self, config: MotionConfig, period_s: float, unit: Unit | None = None) -> None:
        super().__init__()
        self.config = config
        self.config_is_kept = False
        self.period_s = period_s
        self.unit = unit or Unit()
        self.ticks = 0
        self.bus = NOT_OPENED
        self.output = Output()
        self.inquiries = Inquiries()
        self.errands: list[Errand] = []
        self.capture: Capture | None = None
        self.recordings = 0

    @property
    def geometry(self) -> Geometry | None:
        """The calibrated travel, None while uncalibrated."""
        return self.calibrated.geometry

    @property
    def gains(self) -> Gains:
        """The gains of holds and moves: the calibration's, else the default."""
        return self.calibrated.gains

    def use_calibration(
        self,
        calibration: Calibration | None,
        problem: Refusal | None = None,
        file: str | None = None,
    ) -> None:
        """Take a calibration and its file, or the reason why there is none."""
        self.calibrated.use(calibration, problem, file)
        if calibration is not None:
            self.events.append(announce.calibrated(calibration, file))

    def note_bus(self, bus: BusCondition) -> None:
        """Take the state of the bus; a change of it is told once, whatever its errors say.

        What the first attempt to open it leads to is told as well, though that be "down".
        """
        is_first = self.bus == NOT_OPENED and bus != NOT_OPENED
        if is_first or bus.state != self.bus.state:
            self.events.append(announce.bus_changed(self.bus, bus, self.unit.bus_channel))
        self.bus = bus

    def recording_refusal(self) -> Refusal | None:
        """Say that a recording is under way, if so; replay and teleoperation wait for its end."""
        if self.capture is None or self.capture.is_over:
            return None
        text = "a recording is under way: end it (trajectory.record_stop)"
        return Refusal("trajectory_busy", text, {"hint": "trajectory.record_stop"})

    def unsettled(self) -> Refusal | None:
        """Say why no successor can take over now; so does a recording that would be lost."""
        refusal, capture = super().unsettled(), self.capture
        if refusal is None and capture is not None and capture.would_be_lost:
            text = "a recording is not kept yet: end it (trajectory.record_stop)"
            return Refusal("trajectory_busy", text, {"hint": "trajectory.record_stop"})
        return refusal

    # The tick

    def step(self, now_s: float, motor: MotorView) -> MotorOrder:
        """Decide. In this order: power, fault, stop, lost client, the action, the rest."""
        motor = _finite(motor)
        self._note_phase(motor)
        self._note_zero(motor.zero)
        self.ticks += 1
        self.now_s = now_s
        self._step_authority(now_s)
        self._note_second_master(now_s, motor)
        if self.capture is not None:
            self.capture.step(now_s, motor, self.geometry, self.grip, self.jobs)
        inquiry = self.inquiries.step(motor.register)
        if self.must_disable:
            self.must_disable = False
            self._send_nothing(now_s)
            return MotorOrder(request=DisableMotor(), register=inquiry)
        command, request = self._act(now_s)
        feedback = motor.feedback
        if motor.phase is not MotorPhase.ENABLED or feedback is None:
            self._send_nothing(now_s)
            return MotorOrder(request=request, register=inquiry)
        is_motion = command is not None
        command = command or self._rest_command(now_s, feedback)
        self._note_moved_object(feedback)
        return MotorOrder(self._send(now_s, command, feedback), request, is_motion, inquiry)

    def progress(self) -> Progress | None:
        """Tell where the running job is."""
        return None if self.action is None else self.action.progress()

    def take_events(self) -> list[Event]:
        """Return what happened since the last call."""
        events, self.events = self.events, []
        return events

    def _act(self, now_s: float) -> tuple[MitCommand | None, MotorRequest | None]:
        """Step the running action, if its motor is still there."""
        action, motor = self.action, self.motor
        if action is None:
            return None, None
        if action.needs_power and motor.phase is not MotorPhase.ENABLED:
            self.end(motor_refusal(motor) or NOT_ENABLED)
            return None, None
        self.has_stepped = True
        step = action.step(now_s, motor)
        if step.errand is not None:
            self.errands.append(step.errand)
        if step.adopted is not None:
            self.use_calibration(step.adopted.calibration, file=step.adopted.file)
        if step.outcome is not None:
            self.end(step.outcome)
        return step.command, step.request

    def _rest_command(self, now_s: float, feedback: Feedback) -> MitCommand:
        rest, geometry = self.rest, self.geometry
        if isinstance(rest, Hold) and geometry is not None:
            self.rest = rest = rest.eased(feedback.position_rad, geometry)
        command = rest.command(now_s, feedback)
        if isinstance(rest, Grip) and rest.is_lost:
            if rest.watched:
                self.events.append(announce.object_lost(None))
            # On some motors the damping of a position hold would shake running jaws.
            caught_rad = rest.caught_rad(feedback.position_rad, self.period_s)
            self.rest = Hold(caught_rad, self.gains.calmed())
            return self.rest.command(now_s, feedback)
        return command

    def _note_moved_object(self, feedback: Feedback) -> None:
        grip, geometry = self.grip, self.geometry
        moved_mm = None if grip is None else grip.take_moved_mm()
        if grip is not None and grip.is_holding and moved_mm is not None and geometry is not None:
            width_mm = geometry.opening_mm(feedback.position_rad)
            self.events.append(announce.object_moved(moved_mm, width_mm))

    def _send(self, now_s: float, command: MitCommand, feedback: Feedback) -> MitCommand | None:
        """Return what is sent in place of `command`."""
        identity, action = self.motor.identity, self.action
        ranges = Ranges() if identity is None else identity.ranges
        own_bounds = None if action is None else action.bounds
        bounds = own_bounds or bounds_of(self.geometry, self.config)
        change = self.output.send(now_s, command, feedback, bounds, ranges)
        if change is not None:
            self.events.append(announce.heat_changed(change))
        grip, sent = self.grip, self.output.command
        if grip is not None and sent is not None:
            grip.note_sent(sent.torque_nm)
        return sent

    def _send_nothing(self, now_s: float) -> None:
        change = self.output.unpowered(now_s, self.motor.feedback)
        if change is not None:
            self.events.append(announce.heat_changed(change))

    def _note_zero(self, zero: ZeroView) -> None:
        useless = self.calibrated.note_zero(zero)
        if useless is not None:
            content = content_of(useless, self.unit, self.gains, self.motor)
            self.errands.append(save_errand(self.unit, content, self._saved))
            self.events.append(announce.calibrated(useless, self.calibrated.file))
            if self.action is not None and self.action.needs_power:
                self.end(ZERO_MOVED)  # its travel is known no longer

    def _saved(self, result: ErrandResult) -> None:
        if result.error is not None:
            self.events.append(announce.not_saved(result.error))

    def _note_second_master(self, now_s: float, motor: MotorView) -> None:
        """End what runs when another commands the motor; the jaws go on holding."""
        told = self.second_master.step(now_s, motor.foreign_commands, motor.foreign_write)
        if told is not None:
            self.events.append(told)
        refusal, running = self.second_master.refusal(), self.jobs.running
        if refusal is not None and running is not None and running.kind not in _SAFE_JOBS:
            self.end(refusal)

    def _note_phase(self, motor: MotorView) -> None:
        """Whenever the motor becomes enabled, or answers again, hold what is measured now.

        Jaws that were slack before a silence stay slack: a hand may be in them. Those that held
        by force go on, or they would drop what they hold: a motor that says that it is still
        enabled has gone on squeezing meanwhile.
        """
        self.events += announce.motor_changed(self.motor, motor)
        before, self.motor = self.motor.phase, motor
        if motor.phase is before:
            return
        if motor.phase is not MotorPhase.ENABLED or motor.feedback is None:
            return
        was_silent = before is MotorPhase.SILENT
        if was_silent and isinstance(self.rest, Grip):
            self.rest.resume()
        elif not (was_silent and isinstance(self.rest, Relax)):
            self.rest = Hold(motor.feedback.position_rad, self.gains)


def _finite(motor: MotorView) -> MotorView:
    """Leave out a measurement that is no number: nothing may be derived from it."""
    feedback = motor.feedback
    if feedback is None:
        return motor
    total = feedback.position_rad + feedback.velocity_rad_s + feedback.torque_nm
    return motor if math.isfinite(total) else replace(motor, feedback=None)
