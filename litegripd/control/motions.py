"""What clients may ask the gripper to do: each admitted or refused at once, then run by the engine.

A motion's `config` is the caller's own; it counts for this motion only.
"""

from litegripd.control.actions.grasp import BUDGET_NM, Grasp, GraspRequest
from litegripd.control.actions.move import Direction, MoveTo, MoveToStop
from litegripd.control.actions.power import ClearFault, Disable, Enable
from litegripd.control.actions.stream import SetPoint, Stream
from litegripd.control.admission import (
    FAULTLESS,
    NO_FEEDBACK,
    Target,
    busy_refusal,
    conflict_refusal,
    duration_refusal,
    heat_refusal,
    motor_refusal,
    position_refusal,
    target_refusal,
)
from litegripd.control.engine import Engine
from litegripd.control.holds import Grip, GripSettings, Hold, Slack
from litegripd.model.errors import Refusal
from litegripd.model.geometry import FORCE_PER_TORQUE_N_NM, Geometry
from litegripd.model.jobs import Job, Owner
from litegripd.model.motion_config import (
    MotionConfig,
    damping_conflict,
    fast_conflict,
    move_conflict,
    slow_conflict,
)
from litegripd.model.motor import EnableMotor, Feedback, MotorPhase
from litegripd.model.results import ForceResult, HoldResult, MoveResult, SlackResult

SMALLEST_MOVE_RAD = 1e-4


class Motions:
    """Begins motions on one engine; a refusal says why not, and nothing has changed."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def enable(self, owner: Owner, config: MotionConfig, detached: bool) -> Job | Refusal:
        """Begin to enable the motor."""
        engine = self._engine
        refusal = engine.why_busy() or engine.motor.problem
        if refusal is not None:
            return refusal
        request = EnableMotor(config.enable_retries, config.enable_retry_interval)
        return engine.begin("enable", Enable(request), owner, detached)

    def disable(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to disable the motor; ends the owner's own motion, but not another's."""
        engine = self._engine
        running = engine.jobs.running
        if running is not None and running.owner.client == owner.client:
            engine.end(Refusal("cancelled", "ended by motor.disable of the same client"))
        refusal = busy_refusal(engine.jobs.running)
        if refusal is not None:
            return refusal
        return engine.begin("disable", Disable(), owner, detached)

    def clear_fault(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to clear what the motor has latched; it stays disabled."""
        engine = self._engine
        enabled = engine.motor.phase in (MotorPhase.ENABLED, MotorPhase.ENABLING)
        refusal = busy_refusal(engine.jobs.running) or (FAULTLESS if enabled else None)
        if refusal is not None:
            return refusal
        return engine.begin("clear_fault", ClearFault(), owner, detached)

    def move_to_stop(
        self,
        direction: Direction,
        owner: Owner,
        config: MotionConfig,
        speed_mm_s: float | None,
        detached: bool,
    ) -> Job | Refusal:
        """Begin to open or close at `speed_mm_s` (the configured speed by default)."""
        engine, geometry = self._engine, self._ready()
        if isinstance(geometry, Refusal):
            return geometry
        speed = config.speed_mm_s if speed_mm_s is None else speed_mm_s
        refusal = conflict_refusal(move_conflict(config, speed, geometry, engine.period_s))
        if refusal is not None:
            return refusal
        action = MoveToStop(
            direction,
            speed,
            geometry=geometry,
            config=config,
            gains=engine.gains,
            period_s=engine.period_s,
        )
        held = self._held()
        if held is not None and direction == "close":
            return engine.settle("close", held, owner, self._blocked(action.target_rad))
        return engine.begin(direction, action, owner, detached)

    def grasp(
        self, request: GraspRequest, owner: Owner, config: MotionConfig, detached: bool
    ) -> Job | Refusal:
        """Begin to close until something is gripped; what is held already is held on."""
        engine, geometry = self._engine, self._ready()
        if isinstance(geometry, Refusal):
            return geometry
        conflict = slow_conflict(config, request.speed_mm_s, geometry, "grasp_speed_mm_s")
        if conflict is None and request.hold_by == "gains":
            conflict = damping_conflict(config.hold_kp, config.hold_kd, "hold_")
        held = self._held()
        hot = None if held else heat_refusal(engine.output.heat.allowance_nm, BUDGET_NM)
        refusal = conflict_refusal(conflict) or hot
        if refusal is not None:
            return refusal
        action = Grasp(
            request,
            geometry=geometry,
            config=config,
            gains=engine.gains,
            period_s=engine.period_s,
            motor_type=engine.unit.motor_type,
            held=held,
        )
        return engine.begin("grasp", action, owner, detached)

    def move_to(
        self,
        target: Target,
        owner: Owner,
        config: MotionConfig,
        *,
        speed_mm_s: float | None,
        duration_s: float | None,
        detached: bool,
    ) -> Job | Refusal:
        """Begin to move to a position, at a speed (the configured one by default) or in a time."""
        engine, geometry = self._engine, self._ready()
        feedback = engine.motor.feedback
        if isinstance(geometry, Refusal) or feedback is None:
            return geometry if isinstance(geometry, Refusal) else NO_FEEDBACK
        refusal = target_refusal(target, geometry)
        if refusal is not None:
            return refusal
        target_rad = target.position_rad(geometry)
        speed = config.speed_mm_s if speed_mm_s is None else speed_mm_s
        distance_mm = abs(target_rad - feedback.position_rad) * geometry.rad_to_mm
        if duration_s is not None and distance_mm > geometry.rad_to_mm * SMALLEST_MOVE_RAD:
            speed = distance_mm / duration_s
        conflict = fast_conflict(config, speed, engine.period_s)
        refusal = conflict_refusal(conflict)
        if conflict is not None and duration_s is not None:
            refusal = duration_refusal(duration_s, distance_mm / conflict.limit, distance_mm)
        if refusal is not None:
            return refusal
        held = self._held()
        closes = (target_rad - feedback.position_rad) * geometry.close_sign > 0.0
        if held is not None and closes:
            return engine.settle("move", held, owner, self._blocked(target_rad))
        action = MoveTo(
            target_rad,
            geometry.to_rad(speed),
            geometry=geometry,
            config=config,
            gains=engine.gains,
            period_s=engine.period_s,
        )
        return engine.begin("move", action, owner, detached)

    def hold(self, owner: Owner) -> Job | Refusal:
        """Hold from now on: what is held already, else the measured position."""
        engine, feedback = self._engine, self._powered()
        if isinstance(feedback, Refusal):
            return feedback
        rest = engine.rest
        if isinstance(rest, Slack):  # holding anew would lose the force of a hold
            rest = Hold(feedback.position_rad, engine.gains)
        elif isinstance(rest, Grip):
            rest.stay()
        position_rad = rest.position_rad if isinstance(rest, Hold) else feedback.position_rad
        return engine.settle("hold", rest, owner, HoldResult(position_rad))

    def zero_gravity(self, owner: Owner) -> Job | Refusal:
        """Let the jaws go: enabled, but without stiffness, damping and torque."""
        feedback = self._powered()
        if isinstance(feedback, Refusal):
            return feedback
        result = SlackResult(feedback.position_rad)
        return self._engine.settle("zero_gravity", Slack(), owner, result)

    def set_force(self, force_n: float, owner: Owner, config: MotionConfig) -> Job | Refusal:
        """Squeeze by `force_n` from now on: what is gripped, else from where the jaws are.

        The owner's running grasp goes on with it; anybody else's is not touched.
        """
        engine, grip, running = self._engine, self._engine.grip, self._engine.jobs.running
        if grip is not None and running is not None and running.owner.client == owner.client:
            grip.squeeze(force_n)
            return running
        geometry = self._ready()
        feedback = engine.motor.feedback
        if isinstance(geometry, Refusal) or feedback is None:
            return geometry if isinstance(geometry, Refusal) else NO_FEEDBACK
        if grip is None:
            settings = GripSettings.of(geometry, config, config.grasp_speed_mm_s, "torque")
            in_flight_nm = min(
                geometry.close_sign * feedback.torque_nm, force_n / FORCE_PER_TORQUE_N_NM
            )
            motor_type = engine.unit.motor_type
            grip = Grip(settings, force_n, in_flight_nm, motor_type, watched=False)
        grip.squeeze(force_n)
        return engine.settle("set_force", grip, owner, ForceResult(force_n))

    def stream(
        self,
        target: Target,
        owner: Owner,
        *,
        valid_until_s: float,
        speed_mm_s: float | None,
        torque_nm: float,
    ) -> Job | Refusal:
        """Take a set-point that counts until a time of CLOCK_MONOTONIC; the first one begins it."""
        engine = self._engine
        running, action = engine.jobs.running, engine.action
        goes_on = running is not None and running.owner.client == owner.client
        if not (goes_on and isinstance(action, Stream)):
            running, action = None, Stream(engine.gains, engine.period_s)
        geometry = (
            self._ready() if running is None else engine.geometry or engine.calibrated.problem
        )
        if isinstance(geometry, Refusal):
            return geometry
        speed = engine.config.speed_mm_s if speed_mm_s is None else speed_mm_s
        refusal = target_refusal(target, geometry) or conflict_refusal(
            fast_conflict(engine.config, speed, engine.period_s)
        )
        if refusal is not None:
            return refusal
        point = SetPoint(
            target.position_rad(geometry), valid_until_s, geometry.to_rad(speed), torque_nm
        )
        action.set(point)
        return running or engine.begin("stream", action, owner, detached=False)

    def _held(self) -> Grip | None:
        """Return the hold of an object, None without one."""
        grip = self._engine.grip
        return grip if grip is not None and grip.is_holding else None

    def _blocked(self, target_rad: float) -> MoveResult:
        """Return the result of a closing that what is held ends before it begins.

        It would crush the object, and then let go of it.
        """
        geometry, feedback = self._engine.geometry, self._engine.motor.feedback
        limit_rad = target_rad if geometry is None else geometry.closed_rad
        return MoveResult(
            ok=False,
            outcome="blocked",
            reached=False,
            stalled=True,
            protected=False,
            target_rad=target_rad,
            limit_rad=limit_rad,
            final_command_rad=target_rad if feedback is None else feedback.position_rad,
            steps=0,
        )

    def _powered(self) -> Feedback | Refusal:
        """Return the present feedback where the motor is free and enabled, else why not."""
        refusal = self._engine.why_busy() or motor_refusal(self._engine.motor)
        return refusal or self._engine.motor.feedback or NO_FEEDBACK

    def _ready(self) -> Geometry | Refusal:
        """Return the travel where a motion in it may begin, else say why not."""
        engine = self._engine
        refusal = engine.why_busy()
        if refusal is not None:
            return refusal
        geometry = engine.geometry
        if geometry is None:
            return engine.calibrated.problem
        refusal = motor_refusal(engine.motor) or position_refusal(engine.motor, geometry)
        return refusal or geometry
