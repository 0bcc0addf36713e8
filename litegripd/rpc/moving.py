"""The methods that move the jaws or change the motor's power, and those that stop them."""

from collections.abc import Mapping
from typing import Any, Literal

from litegripd.control.actions.grasp import GraspRequest
from litegripd.control.actions.move import Direction
from litegripd.control.admission import Target
from litegripd.control.engine import Engine
from litegripd.control.motions import Motions
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job
from litegripd.model.motion_config import MotionConfig
from litegripd.rpc.answers import Cleared, Stopped
from litegripd.rpc.calls import Answer, Call, Function, later
from litegripd.rpc.reporter import Reporter
from litegripd.rpc.view import JobNumber, StateView

QUANTITIES: tuple[Literal["opening_mm", "position_rad", "openness"], ...] = (
    "opening_mm",
    "position_rad",
    "openness",
)
DEFAULT_VALID_S = 0.2
DEFAULT_CONTACT_NM = 1.0


class Moving:
    """Functions on the engine's motions."""

    def __init__(self, engine: Engine, reporter: Reporter) -> None:
        self._engine = engine
        self._reporter = reporter
        self._motions = Motions(engine)

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "motor.enable": self._enable,
            "motor.disable": lambda call: later(self._motions.disable(call.owner, call.detached)),
            "motor.clear_fault": lambda call: later(
                self._motions.clear_fault(call.owner, call.detached)
            ),
            "motion.open": lambda call: self._to_stop("open", call),
            "motion.close": lambda call: self._to_stop("close", call),
            "motion.grasp": self._grasp,
            "motion.move": self._move,
            "motion.hold": lambda call: later(self._motions.hold(call.owner)),
            "motion.zero_gravity": lambda call: later(self._motions.zero_gravity(call.owner)),
            "motion.set_force": self._set_force,
            "stream.set": self._stream,
            "stop": self._stop,
            "stop.clear": self._clear_stop,
            "job.cancel": self._cancel,
        }

    def _config(self, call: Call) -> MotionConfig | Refusal:
        return call.config(self._engine.config, self._engine.period_s)

    def _enable(self, call: Call) -> Answer:
        config = self._config(call)
        if isinstance(config, Refusal):
            return config
        if "retries" in call.params:
            config = config.changed({"enable_retries": call.params["retries"]}, 0.0)
        return later(self._motions.enable(call.owner, config, call.detached))

    def _to_stop(self, direction: Direction, call: Call) -> Answer:
        config = self._config(call)
        if isinstance(config, Refusal):
            return config
        speed = call.params.get("speed_mm_s")
        return later(
            self._motions.move_to_stop(direction, call.owner, config, speed, call.detached)
        )

    def _grasp(self, call: Call) -> Answer:
        config, params = self._config(call), call.params
        if isinstance(config, Refusal):
            return config
        refusal = _grasp_refusal(params)
        if refusal is not None:
            return refusal
        request = GraspRequest(
            force_n=params.get("force_n", config.force_n),
            speed_mm_s=params.get("speed_mm_s", config.grasp_speed_mm_s),
            hold_s=params.get("hold_s", 0.0),
            until=params.get("until", "held"),
            hold_by=params.get("hold_by", "torque"),
            width_mm=params.get("width_mm"),
            tolerance_mm=params.get("tolerance_mm", 0.0),
        )
        return later(self._motions.grasp(request, call.owner, config, call.detached))

    def _move(self, call: Call) -> Answer:
        config, target = self._config(call), _target("motion.move", call.params)
        if isinstance(config, Refusal):
            return config
        if isinstance(target, Refusal):
            return target
        speed, duration_s = call.params.get("speed_mm_s"), call.params.get("duration_s")
        if speed is not None and duration_s is not None:
            text = "motion.move takes speed_mm_s or duration_s, not both"
            return Refusal("invalid_params", text, {"parameter": "duration_s"})
        return later(
            self._motions.move_to(
                target,
                call.owner,
                config,
                speed_mm_s=speed,
                duration_s=duration_s,
                detached=call.detached,
            )
        )

    def _set_force(self, call: Call) -> Answer:
        config = self._config(call)
        if isinstance(config, Refusal):
            return config
        force_n = call.params["force_n"]
        return self._at_once(self._motions.set_force(force_n, call.owner, config), force_n=force_n)

    def _stream(self, call: Call) -> Answer:
        target = _target("stream.set", call.params)
        if isinstance(target, Refusal):
            return target
        valid_s = call.params.get("valid_s", DEFAULT_VALID_S)
        since_s = min(call.params.get("sent_s", call.received_s), call.received_s)
        if call.now_s >= since_s + valid_s:
            return _expired(call.now_s - since_s, valid_s)
        job = self._motions.stream(
            target,
            call.owner,
            valid_until_s=since_s + valid_s,
            speed_mm_s=call.params.get("speed_mm_s"),
            torque_nm=call.params.get("torque_nm", DEFAULT_CONTACT_NM),
        )
        return job if isinstance(job, Refusal) else JobNumber(job=job.number)

    def _stop(self, call: Call) -> Stopped:
        level, why = call.params.get("level", "hold"), call.params.get("why")
        self._engine.stop(level, call.owner, why, call.now_s)
        latched = self._engine.stop_latch.latched
        return {
            "level": level if latched is None else latched.level,
            "generation": self._engine.stop_latch.generation,
            "state": self._changed_state(),
        }

    def _clear_stop(self, call: Call) -> Cleared:
        self._engine.clear_stop(call.owner)
        return {"generation": self._engine.stop_latch.generation, "state": self._changed_state()}

    def _cancel(self, call: Call) -> Answer:
        job = self._engine.cancel(call.params["job"], call.owner)
        self._reporter.refresh()
        return job if isinstance(job, Refusal) else self._reporter.job(job)

    def _at_once(self, job: Job | Refusal, **figures: float) -> Answer:
        """Answer with what is in force from now on, and the state as this request has left it."""
        if isinstance(job, Refusal):
            return job
        return {"job": job.number, **figures, "state": self._changed_state()}

    def _changed_state(self) -> StateView:
        self._reporter.refresh()
        return self._reporter.state_view()


def _target(method: str, params: Mapping[str, Any]) -> Target | Refusal:
    """Find the one quantity that says where to go."""
    given = [name for name in QUANTITIES if name in params]
    if len(given) != 1:
        text = f"{method} takes exactly one of {', '.join(QUANTITIES)}"
        return Refusal("invalid_params", text, {"parameter": (given or QUANTITIES)[0]})
    return Target(given[0], float(params[given[0]]))


def _expired(age_s: float, valid_s: float) -> Refusal:
    return Refusal(
        "set_point_expired",
        f"the set-point is {age_s:.3f} s old and counts for {valid_s:g} s: the jaws do not follow"
        " it; send newer ones, or a larger valid_s",
        {"age_s": round(age_s, 6), "limit": valid_s},
    )


def _grasp_refusal(params: Mapping[str, Any]) -> Refusal | None:
    """Say which parameters of a grasp do not go together, if so."""
    if ("width_mm" in params) != ("tolerance_mm" in params):
        text = "motion.grasp: width_mm and tolerance_mm go together"
        return Refusal("invalid_params", text, {"parameter": "tolerance_mm"})
    if params.get("until") == "verdict" and "hold_s" in params:
        text = 'motion.grasp: with until = "verdict" leave hold_s out: the hold goes on anyway'
        return Refusal("invalid_params", text, {"parameter": "hold_s"})
    return None
