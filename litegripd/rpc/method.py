"""What a row of the table of methods is, and the parameters that many methods have."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from litegripd.rpc.schema import Param
from litegripd.rpc.sessions import Role

COMMON_PARAMS = (
    Param("sent_s", "number", "When the request was sent, seconds of CLOCK_MONOTONIC.", minimum=0),
    Param("stop_generation", "integer", "The count of stops that the sender knew of.", minimum=0),
)
"""Every method takes these; what was sent before a stop neither moves nor clears after it."""

LEASE = Param("lease", "string", "The token of the lease under which to do it.")
KEY = Param(
    "key",
    "string",
    "The caller's own name for this motion: sent again by the same process, it answers for the same"
    " job. Two processes may use the same name.",
)
IF_BUSY = Param(
    "if_busy",
    "string",
    "While another motion runs: refuse (reject, the default), end the caller's own one and take its"
    " place (replace), or wait for its end (queue).",
    choices=("reject", "replace", "queue"),
)
WAIT = Param("wait", "boolean", "Answer when it has ended (true, the default), or at once.")
DETACH = Param(
    "detach", "boolean", "Let it outlive this connection (default: what is not waited for)."
)
PROGRESS = Param("progress", "boolean", "Send job.progress on the way (default false).")
JOB = Param("job", "integer", "The job's number.", required=True, minimum=1)
CONFIG = Param(
    "config",
    "object",
    "Fields of the motion configuration (config.get lists them) that count for this call only.",
)
RUN_PARAMS = (CONFIG, WAIT, PROGRESS, DETACH, IF_BUSY, KEY)
"""What every motion takes that lasts."""

SPEED_MM_S = (0.1, 500.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One method.

    `returns` is the type of the result when all is done: the schema of it is made from there.
    `role` is the least that its caller must be; `needs_lease` marks those that are for the holder
    of the lease alone, as long as somebody holds it; `stop_voids` those that a stop makes void when
    they were sent before it; `waits` those whose answer comes when a job has ended; `may_notify`
    those that may be sent without an id; `lifts_stop` the one that is for whoever has stopped and
    for admins as well, whatever their role and whoever has the lease.
    """

    name: str
    summary: str
    result: str
    returns: Any
    params: tuple[Param, ...] = ()
    role: Role = "observer"
    needs_lease: bool = False
    stop_voids: bool = False
    waits: bool = False
    may_notify: bool = False
    lifts_stop: bool = False
    declared: Mapping[str, Param] = field(init=False)

    def __post_init__(self) -> None:
        """Index the parameters by name."""
        lease = (LEASE,) if self.needs_lease else ()
        declared = {param.name: param for param in (*self.params, *lease, *COMMON_PARAMS)}
        object.__setattr__(self, "declared", declared)


def speed_param(default: str) -> Param:
    """Describe a jaw speed whose default is this field of the configuration."""
    low, high = SPEED_MM_S
    text = f"Jaw speed (default: {default} of the configuration)."
    return Param("speed_mm_s", "number", text, minimum=low, maximum=high)


def target_params() -> tuple[Param, ...]:
    """Describe where to go, in one of three quantities."""
    return (
        Param("opening_mm", "number", "Where to go: the opening, 0 closed."),
        Param("position_rad", "number", "Where to go: the motor's position."),
        Param(
            "openness",
            "number",
            "Where to go: the share of the travel that is open, 0 to 1.",
            minimum=0,
            maximum=1,
        ),
    )
