"""The rows of the methods that move the jaws or change the motor's power, and that stop them."""

from dataclasses import replace

from litegripd.model.jobs import STOP_LEVELS, Job
from litegripd.model.motion_config import RANGES
from litegripd.model.results import (
    ClearFaultResult,
    DisableResult,
    EnableResult,
    ForceResult,
    GraspResult,
    HoldResult,
    MoveResult,
    SlackResult,
)
from litegripd.rpc.answers import Cleared, Stopped
from litegripd.rpc.method import (
    CONFIG,
    DETACH,
    JOB,
    RUN_PARAMS,
    WAIT,
    Method,
    speed_param,
    target_params,
)
from litegripd.rpc.reports import JobNumber
from litegripd.rpc.schema import Param

_FORCE = Param(
    "force_n",
    "number",
    "Squeezing force, about 0.1 N·m a newton (default: force_n of the configuration).",
    minimum=RANGES["force_n"][0],
    maximum=RANGES["force_n"][1],
)
_FORCE_DUE = replace(_FORCE, description="Squeezing force.", required=True)

_GRASP = Method(
    "motion.grasp",
    "Close until something is gripped, then hold it by force.",
    "ok, outcome, width_mm, force_n, held_s, cycles, and the state.",
    GraspResult,
    (
        _FORCE,
        Param(
            "speed_mm_s",
            "number",
            "Closing speed (default: grasp_speed_mm_s of the configuration).",
            minimum=0.1,
            maximum=200,
        ),
        Param(
            "hold_s",
            "number",
            "Answer after so long a hold; 0 (the default) never: the hold lasts until it is ended."
            " The jaws hold on in any case.",
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
            "Hold by a pure torque (torque, the default), or stiff around a position that is read"
            " every hold_interval, with hold_kp and hold_kd (gains).",
            choices=("torque", "gains"),
        ),
        Param("width_mm", "number", "The width that is expected.", minimum=0, maximum=1000),
        Param("tolerance_mm", "number", "By how much it may differ.", minimum=0, maximum=1000),
        *RUN_PARAMS,
    ),
    role="operator",
    needs_lease=True,
    stop_voids=True,
    waits=True,
)
_MOVE = Method(
    "motion.move",
    "Move to a position inside the calibrated travel, then hold.",
    "The move's result and the state.",
    MoveResult,
    (
        *target_params(),
        speed_param("speed_mm_s"),
        Param(
            "duration_s",
            "number",
            "How long the way shall take, in place of a speed.",
            minimum=0.01,
            maximum=3600,
        ),
        *RUN_PARAMS,
    ),
    role="operator",
    needs_lease=True,
    stop_voids=True,
    waits=True,
)
_SET_FORCE = Method(
    "motion.set_force",
    "Squeeze with this force from now on: what is gripped, else from where the jaws are.",
    "The force and the state.",
    ForceResult,
    (_FORCE_DUE, CONFIG),
    role="operator",
    needs_lease=True,
    stop_voids=True,
)
_STREAM = Method(
    "stream.set",
    "Go towards a set-point; the latest wins. It may be sent without an id, up to 200 times a"
    " second. When none comes in time, the jaws hold where they are. It counts from sent_s, else"
    " from when it was received.",
    "The number of the stream's job.",
    JobNumber,
    (
        *target_params(),
        Param(
            "valid_s",
            "number",
            "How long it counts (default 0.2).",
            minimum=0.02,
            maximum=2,
        ),
        speed_param("speed_mm_s"),
        Param(
            "torque_nm",
            "number",
            "How hard to press on whatever is in the way (default 1).",
            minimum=0.1,
            maximum=3,
        ),
    ),
    role="operator",
    needs_lease=True,
    stop_voids=True,
    may_notify=True,
)
_ZERO_GRAVITY = Method(
    "motion.zero_gravity",
    "Let the jaws go: enabled, but moved freely by hand, until motion.hold or a motion.",
    "The position and the state.",
    SlackResult,
    role="operator",
    needs_lease=True,
    stop_voids=True,
    waits=True,
)

MOVING: tuple[Method, ...] = (
    Method(
        "motor.enable",
        "Energise the motor and hold the measured position.",
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
    ),
    Method(
        "motor.disable",
        "De-energise the motor, confirmed.",
        "ok and the state.",
        DisableResult,
        (WAIT, DETACH),
        role="operator",
        needs_lease=True,
        waits=True,
    ),
    Method(
        "motor.clear_fault",
        "Clear the fault that the motor has latched, confirmed, and accept a position that has"
        " jumped. It energises nothing: motor.enable does.",
        "ok, cleared (the fault's name, null without one) and the state.",
        ClearFaultResult,
        (WAIT, DETACH),
        role="operator",
        needs_lease=True,
        waits=True,
    ),
    Method(
        "motion.open",
        "Open until the mechanical stop ends the move, then hold.",
        "The move's result and the state.",
        MoveResult,
        (speed_param("speed_mm_s"), *RUN_PARAMS),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    Method(
        "motion.close",
        "Close until the mechanical stop ends the move, then hold.",
        "The move's result and the state.",
        MoveResult,
        (speed_param("speed_mm_s"), *RUN_PARAMS),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    _GRASP,
    _MOVE,
    Method(
        "motion.hold",
        "Hold from now on: what is held already, else the measured position.",
        "The position and the state.",
        HoldResult,
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    _ZERO_GRAVITY,
    _SET_FORCE,
    _STREAM,
    Method(
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
    ),
    Method(
        "stop.clear",
        "Allow motions again. While somebody has the lease, that one may, an admin, and whoever has"
        " stopped (by uid); an observer only what nobody else has stopped, too. Refused where a"
        " stop came after it was sent: look, clear again.",
        "The generation and the state.",
        Cleared,
        role="operator",
        needs_lease=True,
        stop_voids=True,
        lifts_stop=True,
    ),
    Method(
        "job.cancel",
        "End a job, running or queued; the jaws go on holding what they hold.",
        "The job.",
        Job,
        (JOB,),
        role="operator",
    ),
)
