"""Requests for motions and calibrations: rejected at once, or made into a job of the controller.

A motion's `terms` are the daemon's own, with what the caller brings for this motion only. The
calibration in use never changes while a motion runs: the travel would change its meaning under it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from litegripd.control.admission import (
    FAULTLESS,
    NO_FEEDBACK,
    Target,
    busy_refusal,
    busy_with,
    conflict_refusal,
    duration_refusal,
    force_refusal,
    heat_refusal,
    motor_refusal,
    position_refusal,
    push_refusal,
    stroke_refusal,
    target_refusal,
    width_refusal,
)
from litegripd.control.calibration import Saving, Terms, content_of, save_task
from litegripd.control.controller import Controller
from litegripd.control.events import NOW, Turn
from litegripd.control.holds import Grip, GripSettings, Hold, Slack
from litegripd.control.limiter import DEFAULT_GAINS, Gains
from litegripd.control.motions.base import ClearFault, Disable, Enable, SetZero
from litegripd.control.motions.calibrate import Calibrate, CalibrateByHand, Side
from litegripd.control.motions.grasp import BUDGET_NM, Grasp, GraspRequest
from litegripd.control.motions.move import Direction, MoveTo, MoveToStop
from litegripd.control.motions.stream import Push, SetPoint, Stream
from litegripd.model.calibration import Calibration, of_stroke
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry, MotorType, Mount
from litegripd.model.motion_config import (
    MotionConfig,
    damping_conflict,
    fast_conflict,
    fastest_mm_s,
    move_conflict,
    slow_conflict,
)
from litegripd.model.motor import EnableMotor, Feedback, MotorPhase
from litegripd.model.sentence import method_name, sentence
from litegripd.model.state import (
    ForceResult,
    HoldResult,
    Job,
    MoveResult,
    Owner,
    SlackResult,
    TaskResult,
)

SMALLEST_MOVE_RAD = 1e-4


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast a move is: one of these, else at the configured speed."""

    speed_mm_s: float | None = None
    duration_s: float | None = None
    at_least_s: float | None = None

    def speed_over(
        self, distance_mm: float, geometry: Geometry, config: MotionConfig, motor_type: MotorType
    ) -> float | Refusal:
        """Return the speed (mm/s) for a way, or a refusal if that is too fast."""
        speed = config.speed_mm_s if self.speed_mm_s is None else self.speed_mm_s
        duration_s = self.duration_s if self.at_least_s is None else self.at_least_s
        if duration_s is not None and distance_mm > geometry.rad_to_mm * SMALLEST_MOVE_RAD:
            speed = distance_mm / duration_s if duration_s > 0.0 else math.inf
        conflict = fast_conflict(speed, geometry, motor_type)
        if conflict is None:
            return speed
        if self.at_least_s is not None:
            return conflict.limit
        if duration_s is not None:
            return duration_refusal(duration_s, distance_mm / conflict.limit, distance_mm)
        return conflict_refusal(conflict) or speed


class MotionRequests:
    """Begins motions on one controller; after a refusal nothing has changed."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def enable(self, owner: Owner, config: MotionConfig, detached: bool) -> Job | Refusal:
        """Begin to enable the motor, once its registers are read."""
        controller = self._controller
        motor = controller.motor
        refusal = controller.why_busy() or (None if motor.is_being_read else motor.problem)
        if refusal is not None:
            return refusal
        request = EnableMotor(config.enable_retries, config.enable_retry_interval)
        return controller.begin("enable", Enable(request), owner, detached)

    def disable(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to disable the motor; end the owner's own motion, but not another client's."""
        controller = self._controller
        running = controller.jobs.running
        if running is not None and running.owner.client == owner.client:
            text = f"{owner.program} (pid {owner.pid}), whose it was, disabled the motor"
            controller.end(Refusal("cancelled", text))
        refusal = busy_refusal(controller.jobs.running)
        if refusal is not None:
            return refusal
        return controller.begin("disable", Disable(), owner, detached)

    def clear_fault(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to clear the fault that the motor has latched; the motor stays disabled."""
        controller = self._controller
        enabled = controller.motor.phase in (MotorPhase.ENABLED, MotorPhase.ENABLING)
        refusal = busy_refusal(controller.jobs.running) or (FAULTLESS if enabled else None)
        if refusal is not None:
            return refusal
        return controller.begin("clear_fault", ClearFault(), owner, detached)

    def move_to_stop(
        self,
        direction: Direction,
        owner: Owner,
        terms: Terms,
        speed_mm_s: float | None,
        *,
        detached: bool,
        turn: Turn,
    ) -> Job | Refusal:
        """Begin to open or close at `speed_mm_s` (the configured speed by default).

        With a work stroke, opening is a plain move to that opening, and never meets the stop. Jaws
        that hold something wider let go of it: they open as far as they can, and press nowhere.
        """
        controller, geometry, config = self._controller, self._ready(terms, turn), terms.config
        if isinstance(geometry, Refusal):
            return geometry
        speed = config.speed_mm_s if speed_mm_s is None else speed_mm_s
        motor_type = controller.gripper_id.motor_type
        refusal = conflict_refusal(move_conflict(config, speed, geometry, motor_type))
        if refusal is not None:
            return refusal
        held, feedback = self._held(turn), controller.motor.feedback
        work_mm = terms.work_opening_mm
        if direction == "open" and work_mm is not None:
            if held is not None and feedback is not None:
                is_wider = geometry.opening_mm(feedback.position_rad) >= work_mm
                work_mm = geometry.travel_mm if is_wider else work_mm
            opening = MoveTo(
                Target("opening_mm", work_mm).position_rad(geometry),
                geometry.to_rad(speed),
                geometry=geometry,
                config=config,
                gains=DEFAULT_GAINS,
                travel_nm=config.travel_nm_at(speed),
                period_s=controller.period_s,
                limit_rad=geometry.open_rad,
            )
            return controller.begin(direction, opening, owner, detached, turn, terms=terms)
        action = MoveToStop(
            direction,
            speed,
            geometry=geometry,
            config=config,
            travel_nm=config.travel_nm_at(speed),
            period_s=controller.period_s,
        )
        if held is not None and direction == "close":
            blocked = self._blocked(action.target_rad, geometry)
            return controller.settle("close", held, owner, blocked, turn, terms=terms)
        return controller.begin(direction, action, owner, detached, turn, terms=terms)

    def grasp(
        self,
        request: GraspRequest,
        owner: Owner,
        terms: Terms,
        *,
        detached: bool,
        turn: Turn,
    ) -> Job | Refusal:
        """Begin to close until something is gripped; an object that is held already stays held."""
        controller, geometry, config = self._controller, self._ready(terms, turn), terms.config
        if isinstance(geometry, Refusal):
            return geometry
        is_default = request.speed_mm_s == config.grasp_speed_mm_s
        field = "grasp_speed_mm_s" if is_default else "speed_mm_s"
        motor_type = controller.gripper_id.motor_type
        conflict = fast_conflict(request.speed_mm_s, geometry, motor_type, field) or slow_conflict(
            config, request.speed_mm_s, geometry, field
        )
        if conflict is None and request.hold_by == "gains":
            conflict = damping_conflict(config.hold_kp, config.hold_kd, "hold_")
        held = self._held(turn)
        hot = None if held else heat_refusal(controller.output.heat.allowance_nm, BUDGET_NM)
        refusal = conflict_refusal(conflict) or hot
        refusal = refusal or force_refusal(request.force_n, geometry, motor_type)
        refusal = refusal or width_refusal(request.width_mm, request.tolerance_mm, geometry)
        if refusal is not None:
            return refusal
        action = Grasp(
            request,
            geometry=geometry,
            config=config,
            period_s=controller.period_s,
            motor_type=motor_type,
            held=held,
            way_nm=controller.way.lately_nm(controller.now_s),
        )
        return controller.begin("grasp", action, owner, detached, turn, terms=terms)

    def move_to(
        self,
        target: Target,
        owner: Owner,
        terms: Terms,
        *,
        pace: Pace,
        gains: Gains,
        detached: bool,
        turn: Turn,
    ) -> Job | Refusal:
        """Begin to move to a position; stiffer gains than the calibration's press no harder."""
        controller, geometry, config = self._controller, self._ready(terms, turn), terms.config
        feedback = controller.motor.feedback
        if isinstance(geometry, Refusal) or feedback is None:
            return geometry if isinstance(geometry, Refusal) else NO_FEEDBACK
        refusal = target_refusal(target, geometry)
        if refusal is not None:
            return refusal
        target_rad = target.position_rad(geometry)
        distance_mm = abs(target_rad - feedback.position_rad) * geometry.rad_to_mm
        speed = pace.speed_over(distance_mm, geometry, config, controller.gripper_id.motor_type)
        if isinstance(speed, Refusal):
            return speed
        held = self._held(turn)
        closes = (target_rad - feedback.position_rad) * geometry.close_sign > 0.0
        if held is not None and closes:
            blocked = self._blocked(target_rad, geometry)
            return controller.settle("move", held, owner, blocked, turn, terms=terms)
        action = MoveTo(
            target_rad,
            geometry.to_rad(speed),
            geometry=geometry,
            config=config,
            gains=gains,
            travel_nm=config.travel_nm_at(speed),
            period_s=controller.period_s,
        )
        return controller.begin("move", action, owner, detached, turn, terms=terms)

    def hold(self, owner: Owner, terms: Terms, turn: Turn) -> Job | Refusal:
        """Hold from now on: the present object or hold, otherwise the measured position.

        What a replaced motion leaves, is held: what it has grasped, or the jaws where they are.
        """
        controller, feedback = self._controller, self._powered(turn)
        if isinstance(feedback, Refusal):
            return feedback
        controller.end_replaced(turn)
        idle = controller.idle
        if isinstance(idle, Slack):  # a new hold would lose the force of the present one
            idle = controller.hold_here(feedback, terms)
        else:
            terms = controller.in_force  # other limits would move what is held
        if isinstance(idle, Grip):
            idle.stay()
        position_rad = idle.position_rad if isinstance(idle, Hold) else feedback.position_rad
        return controller.settle("hold", idle, owner, HoldResult(position_rad), turn, terms=terms)

    def zero_gravity(self, owner: Owner, turn: Turn) -> Job | Refusal:
        """Release the jaws: enabled, but without stiffness, damping and torque."""
        feedback = self._powered(turn)
        if isinstance(feedback, Refusal):
            return feedback
        result = SlackResult(feedback.position_rad)
        return self._controller.settle("zero_gravity", Slack(), owner, result, turn)

    def set_force(self, force_n: float, owner: Owner, terms: Terms) -> Job | Refusal:
        """Squeeze with `force_n` from now on: the present object, or from where the jaws are.

        A running grasp of the owner continues with the new force; another client's is not changed.
        """
        controller, grip = self._controller, self._controller.grip
        running, motor_type = controller.jobs.running, controller.gripper_id.motor_type
        geometry = terms.geometry if grip is None else grip.geometry
        refusal = controller.stop_latch.refusal()
        if refusal is None and geometry is not None:
            refusal = force_refusal(force_n, geometry, motor_type)
        if refusal is not None:
            return refusal
        if grip is not None and running is not None and running.owner.client == owner.client:
            grip.squeeze(force_n)
            return running
        ready, feedback = self._ready(terms), controller.motor.feedback
        if isinstance(ready, Refusal) or feedback is None:
            return ready if isinstance(ready, Refusal) else NO_FEEDBACK
        if grip is None:
            config = terms.config
            settings = GripSettings.of(ready, config, config.grasp_speed_mm_s, "torque")
            in_flight_nm = min(ready.close_sign * feedback.torque_nm, ready.torque_nm(force_n))
            grip = Grip(settings, force_n, in_flight_nm, motor_type, watched=False)
        grip.squeeze(force_n)
        return controller.settle("set_force", grip, owner, ForceResult(force_n), terms=terms)

    def stream(
        self,
        target: Target,
        owner: Owner,
        terms: Terms,
        *,
        valid_until_s: float,
        speed_mm_s: float | None,
        torque_nm: float,
        gains: Gains,
    ) -> Job | Refusal:
        """Take a set-point that is valid until `valid_until_s`; the first one begins the motion."""
        controller, own = self._controller, self._own_stream(owner)
        geometry = self._travel(own, terms)
        if isinstance(geometry, Refusal):
            return geometry
        motor_type = controller.gripper_id.motor_type
        speed = fastest_mm_s(geometry, motor_type) if speed_mm_s is None else speed_mm_s
        refusal = target_refusal(target, geometry) or conflict_refusal(
            fast_conflict(speed, geometry, motor_type)
        )
        if refusal is not None:
            return refusal
        point = SetPoint(
            target.position_rad(geometry), valid_until_s, geometry.to_rad(speed), torque_nm, gains
        )
        return self._go_on(own, point, owner, terms)

    def push(
        self, push_nm: float, owner: Owner, terms: Terms, *, valid_until_s: float
    ) -> Job | Refusal:
        """Take a set-point of torque; the first one begins the motion. With 0 the jaws are slack.

        Slack jaws need no calibration, and may be anywhere.
        """
        controller, own, geometry = self._controller, self._own_stream(owner), terms.geometry
        if push_nm == 0.0:
            free = self._powered() if own is None else None
            refusal = free if isinstance(free, Refusal) else None
        else:
            ready = self._travel(own, terms)
            refusal = (
                ready
                if isinstance(ready, Refusal)
                else push_refusal(push_nm, ready, controller.gripper_id.motor_type)
            )
        if refusal is not None:
            return refusal
        push = Push(push_nm, valid_until_s, geometry, terms.config, terms.gains)
        return self._go_on(own, push, owner, terms)

    def _own_stream(self, owner: Owner) -> tuple[Job, Stream] | None:
        """Return the stream that runs, if it is the owner's."""
        running, action = self._controller.jobs.running, self._controller.action
        is_own = running is not None and running.owner.client == owner.client
        return (running, action) if running and is_own and isinstance(action, Stream) else None

    def _travel(self, own: tuple[Job, Stream] | None, terms: Terms) -> Geometry | Refusal:
        """Return the travel of a set-point; another one in a stream must fit the jaws, too."""
        controller, geometry = self._controller, terms.geometry
        if own is None:
            return self._ready(terms)
        if geometry is None:
            return controller.calibrated.problem
        is_known = geometry == controller.in_force.geometry
        refusal = None if is_known else position_refusal(controller.motor, geometry)
        return refusal or geometry

    def _go_on(
        self, own: tuple[Job, Stream] | None, point: SetPoint | Push, owner: Owner, terms: Terms
    ) -> Job:
        """Give the stream another set-point, and begin one if there is none."""
        controller = self._controller
        if own is None:
            action = Stream(controller.gripper_id.motor_type, controller.period_s)
            action.set(point)
            return controller.begin("stream", action, owner, detached=False, terms=terms)
        running, action = own
        action.set(point)
        controller.put_in_force(terms)
        return running

    def _held(self, turn: Turn) -> Grip | None:
        """Return the hold of an object, None without one."""
        grip = self._controller.grip_at(turn)
        return grip if grip is not None and grip.is_holding else None

    def _blocked(self, target_rad: float, geometry: Geometry) -> MoveResult:
        """Return the result of a closing that is rejected because an object is held.

        It would crush the object, and then let go of it.
        """
        feedback = self._controller.motor.feedback
        return MoveResult(
            ok=False,
            outcome="blocked",
            reached=False,
            stalled=True,
            protected=False,
            target_rad=target_rad,
            limit_rad=geometry.closed_rad,
            final_command_rad=target_rad if feedback is None else feedback.position_rad,
            steps=0,
        )

    def _powered(self, turn: Turn = NOW) -> Feedback | Refusal:
        """Return the present feedback if the motor is free and enabled, otherwise a refusal."""
        refusal = self._controller.why_busy(turn) or motor_refusal(self._controller.motor)
        return refusal or self._controller.motor.feedback or NO_FEEDBACK

    def _ready(self, terms: Terms, turn: Turn = NOW) -> Geometry | Refusal:
        """Return the travel if a motion in it may begin, otherwise a refusal."""
        return self._controller.why_busy(turn) or self._controller.travel(terms)


OnSaved: TypeAlias = Callable[[TaskResult], None]


class CalibrationRequests:
    """Begins calibrations on one controller, and changes the calibration in use."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def zero(
        self,
        owner: Owner,
        config: MotionConfig,
        *,
        mount: Mount | None,
        stroke_mm: float | None,
        keep: bool,
        detached: bool,
        turn: Turn,
    ) -> Job | Refusal:
        """Begin to probe both stops; `mount` sets the direction, otherwise the calibration does.

        `stroke_mm` is how far the jaws open, None for what is configured.
        """
        controller = self._controller
        refusal = self._unready(turn) or stroke_refusal(stroke_mm, controller.gripper_id)
        if refusal is not None:
            return refusal
        if mount is not None:
            close_sign = 1 if mount == "normal" else -1
        elif controller.geometry is not None:
            close_sign = controller.geometry.close_sign
        else:
            return controller.calibrated.problem
        action = Calibrate(close_sign, config, self._saving(stroke_mm, keep=keep))
        return controller.begin("zero", action, owner, detached, turn)

    def by_hand(self, owner: Owner, config: MotionConfig) -> Job | Refusal:
        """Begin a calibration by hand: the jaws go slack."""
        refusal = self._unready()
        if refusal is not None:
            return refusal
        return self._controller.begin("calibrate_by_hand", CalibrateByHand(config), owner, False)

    def mark(self, side: Side, owner: Owner) -> dict[Side, float] | Refusal:
        """Take the present position as a stop; return all marks so far, in rad."""
        action = self._by_hand_of(owner)
        if isinstance(action, Refusal):
            return action
        return action.mark(side) or dict(action.marks)

    def finish(self, owner: Owner, *, stroke_mm: float | None, keep: bool) -> Job | Refusal:
        """Make a calibration of the marks; the job ends when it is in use."""
        controller = self._controller
        action, running = self._by_hand_of(owner), controller.jobs.running
        if isinstance(action, Refusal):
            return action
        refusal = stroke_refusal(stroke_mm, controller.gripper_id)
        if refusal is not None:
            return refusal
        return action.finish(self._saving(stroke_mm, keep=keep)) or running or _NOT_BY_HAND

    def give_up(self, owner: Owner) -> Refusal | None:
        """End a calibration by hand without a result; the jaws hold where they are."""
        action = self._by_hand_of(owner)
        if isinstance(action, Refusal):
            return action
        self._controller.end(Refusal("cancelled", "the calibration by hand was given up"))
        return None

    def set_zero(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to make the present position the motor's zero."""
        controller = self._controller
        refusal = controller.why_busy() or (None if controller.motor.feedback else NO_FEEDBACK)
        if refusal is not None:
            return refusal
        return controller.begin("set_zero", SetZero(), owner, detached)

    def refusal_to_load(self) -> Refusal | None:
        """Return why no other calibration may be loaded now, or None."""
        return busy_refusal(self._controller.jobs.running)

    def load(self, calibration: Calibration, file: str | None, owner: Owner) -> Refusal | None:
        """Use another calibration, which `owner` has loaded; one that cannot fit is refused."""
        controller = self._controller
        calibration = of_stroke(calibration, controller.gripper_id.stroke_mm)
        refusal = self.refusal_to_load() or controller.calibrated.why_unfitting(
            calibration, file, controller.gripper_id, controller.motor.identity
        )
        if refusal is None:
            controller.use_calibration(calibration, file=file, by=owner.client)
        return refusal

    def rescale(self, stroke_mm: float | None, owner: Owner) -> Refusal | None:
        """Give the calibration in use the scale of jaws that open `stroke_mm` (configured: None).

        The limits stay: nothing is measured again, and nothing moves.
        """
        controller = self._controller
        calibration = controller.calibrated.valid
        if calibration is None:
            return controller.calibrated.problem
        refusal = stroke_refusal(stroke_mm, controller.gripper_id)
        if refusal is not None:
            return refusal
        stroke_mm = controller.gripper_id.stroke_mm if stroke_mm is None else stroke_mm
        try:
            rescaled = calibration.rescaled(stroke_mm)
        except ValueError as error:
            text = sentence("{.stroke_mm} is {value:g}: {error}", value=stroke_mm, error=error)
            return Refusal("out_of_limits", text)
        return self.load(rescaled, controller.calibrated.file, owner)

    def save(self, on_saved: OnSaved, uid: int | None = None) -> Refusal | None:
        """Let the helper write the calibration in use to the daemon's own file."""
        controller = self._controller
        calibration = controller.calibrated.valid
        if calibration is None:
            return controller.calibrated.problem
        content = content_of(calibration, controller.gripper_id, controller.gains, controller.motor)

        def saved(result: TaskResult) -> None:
            if result.error is None and isinstance(result.value, dict):
                stored = result.value
                controller.calibrated.note_saved(
                    calibration, controller.gripper_id.channel, stored["path"], stored["saved_s"]
                )
            on_saved(result)

        controller.tasks.append(replace(save_task(controller.gripper_id, content, saved), uid=uid))
        return None

    def _saving(self, stroke_mm: float | None, *, keep: bool) -> Saving:
        controller = self._controller
        before, gripper_id = controller.calibrated.calibration, controller.gripper_id
        return Saving(before, gripper_id, controller.gains, stroke_mm=stroke_mm, keep=keep)

    def _unready(self, turn: Turn = NOW) -> Refusal | None:
        controller = self._controller
        return controller.why_busy(turn) or motor_refusal(controller.motor)

    def _by_hand_of(self, owner: Owner) -> CalibrateByHand | Refusal:
        running, action = self._controller.jobs.running, self._controller.action
        if not isinstance(action, CalibrateByHand) or running is None:
            return _NOT_BY_HAND
        if running.owner.client != owner.client:
            return busy_with(running)
        return action


_NOT_BY_HAND = Refusal(
    "not_calibrated",
    sentence("no calibration by hand is under way: begin one ({calibration.manual})"),
    {"hint": method_name("calibration.manual")},
)
