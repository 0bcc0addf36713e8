"""The methods that move the jaws or change the motor's power, and those that stop them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypedDict

from litegripd.control.admission import Target
from litegripd.control.controller import Controller
from litegripd.control.limiter import DEFAULT_GAINS
from litegripd.control.motions.grasp import GraspRequest
from litegripd.control.motions.move import Direction
from litegripd.control.requests import MotionRequests, Pace
from litegripd.model.errors import Refusal
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.model.motion_config import MOVING_KP_NM_RAD, REACHING_KP_NM_RAD
from litegripd.model.sentence import joined, method_name, parameter_name, sentence
from litegripd.model.state import (
    STOP_LEVELS,
    ClearFaultResult,
    DisableResult,
    EnableResult,
    ForceResult,
    GraspResult,
    HoldResult,
    Job,
    MoveResult,
    SlackResult,
    StopLevel,
)
from litegripd.rpc.method import (
    CALIBRATION,
    CONFIG,
    DETACH,
    IF_BUSY,
    JOB,
    MOTION_PARAMS,
    SPEED,
    WAIT,
    Answer,
    Call,
    Method,
    Param,
    Refused,
    accepted,
    config_param,
    gain_params,
    later,
    target_params,
    usual_gain_params,
)
from litegripd.rpc.reports import JobNumber, Reporter, StateView

QUANTITIES: tuple[Literal["opening_mm", "position_rad", "openness"], ...] = (
    "opening_mm",
    "position_rad",
    "openness",
)
DEFAULT_VALID_S = 0.2
DEFAULT_CONTACT_NM = 1.0


class StopCount(TypedDict):
    """The count of stops."""

    generation: int
    state: StateView


class Cleared(StopCount):
    """The level of the stop that was latched, null if none was."""

    cleared: StopLevel | None


class Stopped(StopCount):
    """The stop that is latched now."""

    level: StopLevel


_FORCE = config_param(
    "force_n", "Squeezing force, about 0.1 N·m a newton (default: force_n of the configuration)."
)
_FORCE_DUE = replace(_FORCE, description="Squeezing force.", required=True)


class MotionMethods:
    """Methods on the controller's motions, and on its stop."""

    def __init__(self, controller: Controller, reporter: Reporter) -> None:
        self._controller = controller
        self._reporter = reporter
        self._motions = MotionRequests(controller)

    @Method(
        "motor.enable",
        "Energise the motor and hold the measured position. While the registers of a motor whose"
        " power is just back are read, it waits, for 3 s at most.",
        "ok, tries, message and the state.",
        EnableResult,
        (
            Param("retries", "integer", "Attempts at most.", minimum=1, maximum=20),
            CONFIG,
            WAIT,
            DETACH,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _enable(self, call: Call) -> Answer:
        config = call.config(self._controller)
        if "retries" in call.params:
            config = replace(config, enable_retries=call.params["retries"])
        return later(self._motions.enable(call.owner, config, call.detached))

    @Method(
        "motor.disable",
        "De-energise the motor, confirmed.",
        "ok and the state.",
        DisableResult,
        (WAIT, DETACH),
        role="operator",
        needs_lease=True,
        waits=True,
    )
    def _disable(self, call: Call) -> Answer:
        return later(self._motions.disable(call.owner, call.detached))

    @Method(
        "motor.clear_fault",
        "Clear the fault that the motor has latched, confirmed, and accept a position that has"
        " jumped. It energises nothing: motor.enable does.",
        "ok, cleared (the fault's name, null without one) and the state.",
        ClearFaultResult,
        (WAIT, DETACH),
        role="operator",
        needs_lease=True,
        waits=True,
    )
    def _clear_fault(self, call: Call) -> Answer:
        return later(self._motions.clear_fault(call.owner, call.detached))

    @Method(
        "motion.open",
        "Open until the mechanical stop ends the move, or to the calibration's work_stroke_mm, then"
        " hold.",
        "The move's result and the state.",
        MoveResult,
        (SPEED, *MOTION_PARAMS),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _open(self, call: Call) -> Answer:
        return self._to_stop("open", call)

    @Method(
        "motion.close",
        "Close until the mechanical stop ends the move, then hold.",
        "The move's result and the state.",
        MoveResult,
        (SPEED, *MOTION_PARAMS),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _close(self, call: Call) -> Answer:
        return self._to_stop("close", call)

    def _to_stop(self, direction: Direction, call: Call) -> Answer:
        terms, speed = call.terms(self._controller), call.params.get("speed_mm_s")
        return later(
            self._motions.move_to_stop(
                direction, call.owner, terms, speed, detached=call.detached, turn=call.turn
            )
        )

    @Method(
        "motion.grasp",
        "Close until something is gripped, then hold it by force.",
        "ok, outcome, width_mm, force_n, held_s, cycles, speed_mm_s, and the state.",
        GraspResult,
        (
            _FORCE,
            Param(
                "speed_mm_s",
                "number",
                "The highest closing speed (default: grasp_speed_mm_s of the configuration); for a"
                " small force the jaws close slower.",
                minimum=0.1,
                maximum=FASTEST_MM_S,
            ),
            Param(
                "hold_s",
                "number",
                "Answer after so long a hold; 0 (the default) never: the hold lasts until it is"
                " ended. The jaws hold on in any case.",
                minimum=0,
                maximum=86_400,
            ),
            Param(
                "until",
                "string",
                "Answer when the hold is over (held, the default) or when it has begun (verdict).",
                choices=("held", "verdict"),
            ),
            Param(
                "hold_by",
                "string",
                "Hold by a pure torque (torque, the default), or stiff around a position that is"
                " read every hold_interval, with hold_kp and hold_kd (gains).",
                choices=("torque", "gains"),
            ),
            Param("width_mm", "number", "The width that is expected.", minimum=0, maximum=1000),
            Param("tolerance_mm", "number", "By how much it may differ.", minimum=0, maximum=1000),
            *MOTION_PARAMS,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _grasp(self, call: Call) -> Answer:
        terms, params = call.terms(self._controller), call.params
        config = terms.config
        if "width_mm" in params and "tolerance_mm" not in params:
            text = sentence(
                "{motion.grasp}: {.width_mm} is given without {.tolerance_mm}: say how far the"
                " width may differ, 2 mm for example"
            )
            raise Refused(Refusal("invalid_params", text, {"parameter": "tolerance_mm"}))
        if "tolerance_mm" in params and "width_mm" not in params:
            text = sentence(
                "{motion.grasp}: {.tolerance_mm} is given without {.width_mm}: say which width is"
                " expected, 20 mm for example"
            )
            raise Refused(Refusal("invalid_params", text, {"parameter": "width_mm"}))
        if params.get("until") == "verdict" and "hold_s" in params:
            text = sentence(
                '{motion.grasp}: with until = "verdict" leave {.hold_s} out: the hold continues'
                " anyway"
            )
            raise Refused(Refusal("invalid_params", text, {"parameter": "hold_s"}))
        request = GraspRequest(
            force_n=params.get("force_n", config.force_n),
            speed_mm_s=params.get("speed_mm_s", config.grasp_speed_mm_s),
            hold_s=params.get("hold_s", 0.0),
            until=params.get("until", "held"),
            hold_by=params.get("hold_by", "torque"),
            width_mm=params.get("width_mm"),
            tolerance_mm=params.get("tolerance_mm", 0.0),
        )
        return later(
            self._motions.grasp(request, call.owner, terms, detached=call.detached, turn=call.turn)
        )

    @Method(
        "motion.move",
        "Move to a position inside the calibrated travel, then hold.",
        "The move's result and the state.",
        MoveResult,
        (
            *target_params(),
            SPEED,
            Param(
                "duration_s",
                "number",
                "How long the way shall take, in place of a speed.",
                minimum=0.01,
                maximum=3600,
            ),
            Param(
                "at_least_s",
                "number",
                "How long the way shall take, in place of a speed; longer where the fastest speed"
                " that fits the configuration needs more.",
                minimum=0,
                maximum=3600,
            ),
            *usual_gain_params(),
            *MOTION_PARAMS,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _move(self, call: Call) -> Answer:
        terms, target = call.terms(self._controller), _target("motion.move", call.params)
        given = [name for name in _PACES if name in call.params]
        if len(given) > 1:
            text = sentence(
                "{motion.move} takes {one} or {other}, not both",
                one=parameter_name(given[0]),
                other=parameter_name(given[1]),
            )
            raise Refused(Refusal("invalid_params", text, {"parameter": given[1]}))
        pace = Pace(*(call.params.get(name) for name in _PACES))
        return later(
            self._motions.move_to(
                target,
                call.owner,
                terms,
                pace=pace,
                gains=call.gains(DEFAULT_GAINS),
                detached=call.detached,
                turn=call.turn,
            )
        )

    @Method(
        "motion.hold",
        "Hold from now on: what is held already, else the measured position.",
        "The position and the state.",
        HoldResult,
        (CALIBRATION, IF_BUSY),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _hold(self, call: Call) -> Answer:
        return later(self._motions.hold(call.owner, call.terms(self._controller), call.turn))

    @Method(
        "motion.zero_gravity",
        "Let the jaws go: enabled, but moved freely by hand, until motion.hold or a motion.",
        "The position and the state.",
        SlackResult,
        (IF_BUSY,),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _zero_gravity(self, call: Call) -> Answer:
        return later(self._motions.zero_gravity(call.owner, call.turn))

    @Method(
        "motion.set_force",
        "Squeeze with this force from now on: what is gripped, else from where the jaws are.",
        "The force and the state.",
        ForceResult,
        (_FORCE_DUE, CONFIG, CALIBRATION),
        role="operator",
        needs_lease=True,
        stop_voids=True,
    )
    def _set_force(self, call: Call) -> Answer:
        terms, force_n = call.terms(self._controller), call.params["force_n"]
        return self._at_once(self._motions.set_force(force_n, call.owner, terms), force_n=force_n)

    @Method(
        "stream.set",
        "Go towards a set-point; the latest wins. It may be sent without an id, up to 200 times a"
        " second. When none comes in time, the jaws hold where they are. It counts from sent_s,"
        " else from when it was received.",
        "The number of the stream's job.",
        JobNumber,
        (
            *target_params(),
            Param(
                "push_nm",
                "number",
                "In place of where to go: the motor's torque, N·m, towards increasing radians if"
                " positive. It pushes free jaws at 1.7 rad/s at most, and may be what a grip may"
                " have, 4 and 40 N on a DM4310. With 0 they are slack. It takes none of speed_mm_s,"
                " torque_nm, kp and kd.",
            ),
            Param(
                "valid_s",
                "number",
                "How long it counts (default 0.2).",
                minimum=0.02,
                maximum=2,
            ),
            config_param(
                "speed_mm_s",
                "How fast to follow at most (default: as fast as any motion may be). While it holds"
                " the jaws back, limited of the state has speed.",
            ),
            Param(
                "torque_nm",
                "number",
                "How hard to press on whatever is in the way (default 1).",
                minimum=0.1,
                maximum=3,
                maximum_of=lambda motor: motor.rated_nm,
            ),
            *gain_params(
                "default: the calibration's,"
                f" within {REACHING_KP_NM_RAD:g} to {MOVING_KP_NM_RAD:g}",
                "default: the calibration's",
            ),
            CALIBRATION,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        may_notify=True,
    )
    def _stream(self, call: Call) -> Answer:
        params, target = call.params, None
        if "push_nm" in params:
            _check_push(params)
        else:
            target = _target("stream.set", params, "push_nm")
        valid_s = params.get("valid_s", DEFAULT_VALID_S)
        since_s = min(params.get("sent_s", call.received_s), call.received_s)
        if call.now_s >= since_s + valid_s:
            return _expired(call.now_s - since_s, valid_s)
        terms, until_s = call.terms(self._controller), since_s + valid_s
        if target is None:
            push_nm = float(params["push_nm"])
            job = self._motions.push(push_nm, call.owner, terms, valid_until_s=until_s)
        else:
            job = self._motions.stream(
                target,
                call.owner,
                terms,
                valid_until_s=until_s,
                speed_mm_s=params.get("speed_mm_s"),
                torque_nm=params.get("torque_nm", DEFAULT_CONTACT_NM),
                gains=call.gains(terms.gains.following()),
            )
        return JobNumber(job=accepted(job).number)

    @Method(
        "stop",
        "Stop and latch: nothing moves until stop.clear. Anybody may.",
        "The latched level, the generation and the state.",
        Stopped,
        (
            Param(
                "level",
                "string",
                "Freeze the position (hold, the default), go slack (relax), or disable.",
                choices=STOP_LEVELS,
            ),
            Param("why", "string", "A reason, shown to everybody whom the stop refuses."),
        ),
    )
    def _stop(self, call: Call) -> Stopped:
        level, why = call.params.get("level", "hold"), call.params.get("why")
        self._controller.stop(level, call.owner, why, call.now_s)
        latched = self._controller.stop_latch.latched
        return {
            "level": level if latched is None else latched.level,
            "generation": self._controller.stop_latch.generation,
            "state": self._changed_state(),
        }

    @Method(
        "stop.clear",
        "Allow motions again. While somebody has the lease, that one may, an admin, and anyone who"
        " has stopped (by uid); an observer only what nobody else has stopped, too. Refused where a"
        " stop came after it was sent: look, clear again.",
        "The level that was latched (null: none was), the generation and the state.",
        Cleared,
        role="operator",
        needs_lease=True,
        stop_voids=True,
        lifts_stop=True,
    )
    def _clear_stop(self, call: Call) -> Cleared:
        latched = self._controller.stop_latch.latched
        self._controller.clear_stop(call.owner)
        return {
            "cleared": None if latched is None else latched.level,
            "generation": self._controller.stop_latch.generation,
            "state": self._changed_state(),
        }

    @Method(
        "job.cancel",
        "End a job, running or queued; the jaws keep holding what they hold.",
        "The job.",
        Job,
        (JOB,),
        role="operator",
    )
    def _cancel(self, call: Call) -> Answer:
        job = self._controller.cancel(call.params["job"], call.owner)
        self._reporter.refresh()
        return self._reporter.job(accepted(job))

    def _at_once(self, job: Job | Refusal, **figures: float) -> Answer:
        """Answer with what is in force from now on, and the state as this request has left it."""
        return {"job": accepted(job).number, **figures, "state": self._changed_state()}

    def _changed_state(self) -> StateView:
        self._reporter.refresh()
        return self._reporter.state_view()


_PACES = ("speed_mm_s", "duration_s", "at_least_s")


def _target(method: str, params: Mapping[str, Any], *others: str) -> Target:
    """Return the target: exactly one quantity must be given, and none of the others."""
    given = [name for name in QUANTITIES if name in params]
    if len(given) != 1 or any(name in params for name in others):
        text = sentence(
            "{method} takes exactly one of {quantities}",
            method=method_name(method),
            quantities=joined(", ", map(parameter_name, (*QUANTITIES, *others))),
        )
        raise Refused(Refusal("invalid_params", text, {"parameter": (given or QUANTITIES)[0]}))
    return Target(given[0], float(params[given[0]]))


_OF_POSITIONS = ("speed_mm_s", "torque_nm", "kp", "kd")


def _check_push(params: Mapping[str, Any]) -> None:
    """Refuse what says how to follow a position: a push follows none."""
    if any(name in params for name in QUANTITIES):
        _target("stream.set", params, "push_nm")
    wrong = next((name for name in _OF_POSITIONS if name in params), None)
    if wrong is not None:
        text = sentence(
            "{stream.set}: {wrong} does not go with {.push_nm}, which is the whole torque: leave it"
            " out",
            wrong=parameter_name(wrong),
        )
        raise Refused(Refusal("invalid_params", text, {"parameter": wrong}))


def _expired(age_s: float, valid_s: float) -> Refusal:
    return Refusal(
        "set_point_expired",
        sentence(
            "the set-point is {age_s:.3f} s old and counts for {valid_s:g} s: the jaws do not"
            " follow it; send newer ones, or a larger {.valid_s}",
            age_s=age_s,
            valid_s=valid_s,
        ),
        {"age_s": round(age_s, 6), "limit": valid_s},
    )
