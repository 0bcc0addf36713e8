"""The table of methods: names, parameters and what they do. Answers, checks and docs follow it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

from litegripd.model.jobs import STOP_LEVELS
from litegripd.model.state import GripperState
from litegripd.rpc.schema import Param

STATE_FIELDS = tuple(field.name for field in fields(GripperState))
MAX_RATE_HZ = 1000.0

COMMON_PARAMS = (
    Param("sent_s", "number", "When the request was sent, seconds of CLOCK_MONOTONIC.", minimum=0),
    Param("stop_generation", "integer", "The count of stops that the sender knew of.", minimum=0),
)
"""Every method takes these; a motion that was sent before a stop never runs after it."""

_WAIT = Param("wait", "boolean", "Answer when it has ended (true, the default), or at once.")
_DETACH = Param("detach", "boolean", "Let it outlive this connection (default false).")
_PROGRESS = Param("progress", "boolean", "Send job.progress on the way (default false).")
_JOB = Param("job", "integer", "The job's number.", required=True, minimum=1)
_ON_LOST = Param(
    "on_lost",
    "string",
    "What the jaws do when this connection, having enabled the motor, ends: keep the present hold"
    " (hold, the default), go slack (relax) or be disabled (disable).",
    choices=("hold", "relax", "disable"),
)
_SPEED = Param("speed_mm_s", "number", "Jaw speed (default: as configured).", minimum=0.1)
_MOVE_PARAMS = (_SPEED, _WAIT, _PROGRESS, _DETACH)


@dataclass(frozen=True, slots=True)
class Method:
    """One method.

    `moves` marks those that a stop makes void when they were sent before it, `waits` those whose
    answer comes when a job has ended.
    """

    name: str
    summary: str
    result: str
    params: tuple[Param, ...] = ()
    moves: bool = False
    waits: bool = False
    declared: Mapping[str, Param] = field(init=False)

    def __post_init__(self) -> None:
        """Index the parameters by name."""
        declared = {param.name: param for param in (*self.params, *COMMON_PARAMS)}
        object.__setattr__(self, "declared", declared)


METHODS: tuple[Method, ...] = (
    Method(
        "hello",
        "Tell who is there: versions, channel, motor, limits, stop generation.",
        "The daemon's description.",
        (Param("client", "string", "The program's name, for the log and for other clients."),),
    ),
    Method("rpc.discover", "Describe the methods.", "An OpenRPC document."),
    Method("health", "Tell how the daemon fares.", "A verdict, its reasons, and the figures."),
    Method("state.get", "Tell the gripper's present state.", "The state."),
    Method(
        "state.subscribe",
        "Send the state again and again, as state.sample notifications.",
        "The number of the subscription and the present state.",
        (
            Param(
                "hz",
                "number",
                "Samples a second (default 20), at most the control rate.",
                minimum=0.1,
                maximum=MAX_RATE_HZ,
            ),
            Param("fields", "strings", "Only these fields (default: all).", choices=STATE_FIELDS),
        ),
    ),
    Method(
        "state.unsubscribe",
        "End a subscription of this connection.",
        "The number of the subscription.",
        (Param("subscription", "integer", "Its number.", required=True, minimum=1),),
    ),
    Method("info.get", "Tell what does not change: motor, calibration, configuration.", "Facts."),
    Method(
        "motor.enable",
        "Energise the motor and hold the measured position.",
        "ok, tries, message and the state.",
        (
            Param("retries", "integer", "Attempts at most.", minimum=1, maximum=20),
            _ON_LOST,
            _WAIT,
            _DETACH,
        ),
        moves=True,
        waits=True,
    ),
    Method(
        "motor.keep",
        "Change what the jaws do when this connection, having enabled the motor, ends.",
        "kept: whether this connection is the one that enabled the motor.",
        (replace(_ON_LOST, required=True),),
    ),
    Method(
        "motor.disable",
        "De-energise the motor, confirmed.",
        "ok and the state.",
        (_WAIT, _DETACH),
        waits=True,
    ),
    Method(
        "motion.open",
        "Open until the mechanical stop ends the move, then hold.",
        "The move's result and the state.",
        _MOVE_PARAMS,
        moves=True,
        waits=True,
    ),
    Method(
        "motion.close",
        "Close until the mechanical stop ends the move, then hold.",
        "The move's result and the state.",
        _MOVE_PARAMS,
        moves=True,
        waits=True,
    ),
    Method(
        "motion.hold",
        "Hold from now on: what is held already, else the measured position.",
        "The position and the state.",
        moves=True,
        waits=True,
    ),
    Method(
        "stop",
        "Stop and latch: nothing moves until stop.clear. Anybody may.",
        "The latched level, the generation and the state.",
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
    Method("stop.clear", "Allow motions again.", "The generation and the state."),
    Method("job.list", "List the jobs that are kept, the oldest first.", "The jobs."),
    Method("job.get", "Tell about one job.", "The job.", (_JOB,)),
    Method("job.wait", "Wait until a job has ended.", "The job.", (_JOB,), waits=True),
    Method("job.cancel", "End a running job; the jaws hold where they are.", "The job.", (_JOB,)),
)

BY_NAME: Mapping[str, Method] = {method.name: method for method in METHODS}
