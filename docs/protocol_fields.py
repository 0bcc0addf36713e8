"""What the page on the protocol says of answers and notifications: their kinds and fields.

Types come from the daemon's own values; a field without a meaning in these tables is an error.
"""

import inspect
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from litegrip_client.values.severity import SEVERITIES, WARNINGS
from litegripd.app.build import METHODS, SIMULATED_METHODS
from litegripd.control.snapshot import GripperState, Mode
from litegripd.model.state import (
    JobKind,
    JobState,
    Progress,
    ReplayProgress,
    Result,
)
from litegripd.model.teleop import TeleopStatus
from litegripd.rpc.method import REFERENCE, Method, Schema, Schemas
from litegripd.rpc.openrpc import FORMS, NOTIFICATIONS, result_schema

MODES: Mapping[Mode, str] = {
    "offline": "The motor does not answer, or has not been heard of yet.",
    "disabled": "The motor is off.",
    "enabling": "It is being enabled.",
    "holding": "It is enabled, and no job runs: the jaws hold where they are, or what they have"
    " gripped.",
    "moving": "A job runs, also while the jaws rest in it: a `motion.grasp` that is answered only"
    " at its end, while it holds; a recording; teleoperation. Whether the jaws move,"
    " `velocity_rad_s` says (the Python client's `is_moving`); whether they hold something,"
    " `is_grasped`.",
    "relaxed": "It is enabled, no job runs, and the jaws are slack: after `motion.zero_gravity`, or"
    " a stop that relaxes.",
    "disabling": "It is being disabled.",
    "fault": "It has a fault and makes no torque: enable it, or clear the fault.",
}

_JSON_NAMES = {
    int: "integer",
    float: "number",
    bool: "boolean",
    str: "string",
    type(None): "null",
}

PARAMS: Mapping[str, str] = {
    "state.sample": (
        "`subscription`, `seq`, `dropped`, `monotonic_s`, `state`. The latest wins: a "
        "client that does not read loses samples and is told how many. `seq` counts the "
        "samples that were due, `dropped` those of them that were not sent."
    ),
    "state.batch": (
        "`subscription`, `seq` (of the last row), `dropped`, `fields`, and `rows`, each "
        "the values of the fields in one sample. A batch for a client that does not read "
        "is dropped as a whole."
    ),
    "event": (
        "`subscription`, `seq`, `monotonic_s`, `kind`, `message`, `data` (an object, "
        "other for each kind; `object_moved` has `moved_mm` and `width_mm`, `weak` has `weak`,"
        " `made_nm`, `commanded_nm` and `hint` (what to do, or null), `pressing` has `pressing_n`,"
        " `most_n` (the most so far), `kind` (the motion that led the jaws there) and `job` (its"
        " number while it runs),"
        " `released_by_fault` has `why`, which says what to do, too, and `past`, what its message"
        " says once the fault is over). `seq`"
        " counts all events since the daemon's start, those of other kinds included. No event is"
        " dropped. The journal, dumps and the page show these kinds as warnings: "
        + ", ".join(f"`{kind}`" for kind in SEVERITIES if kind in WARNINGS)
        + "; and every event whose data has `error` or `warning`, but none with `at_rest`."
    ),
    "job.progress": ("See [below](#progress)."),
    "stream.refused": (
        "An error's: `code`, `message`, `data` with `reason` ([errors.md](errors.md))."
    ),
    "teleop.send": (
        "`topic`, the key, and `payload`, the bytes in hexadecimal digits: a master's frames, a"
        " slave's ready bytes ([teleoperation-wire.md](teleoperation-wire.md))."
    ),
    "teleop.refused": ("As `stream.refused`."),
    "lease.lost": (
        "`client`, `pid` and `uid` of the loser, `cause` (`connection`, `process`, "
        "`expired` or `taken`), `why` (a text of the taker's, or null), `on_lost` (what "
        "the jaws do: hold, relax or disable) and, where it was taken, `by` (`pid`, "
        "`uid`, `program`)."
    ),
}
"""What the parameters of each kind of notification say."""

JOB: Mapping[str, str] = {
    "job": "integer: its number",
    "kind": "string: " + ", ".join(get_args(JobKind)),
    "state": "string: " + ", ".join(state.value for state in JobState),
    "owner": "object: `client` (the connection's number), `pid`, `uid`, `program`",
    "detached": "boolean: whether it outlives its connection",
    "started_s": "number: when it began, CLOCK_MONOTONIC",
    "ended_s": "number, or null while it runs",
    "phase": "string, or null: where it is, while it runs",
    "error": "object, or null: why it could not run its course, as an error's",
    "result": "object, or null: what it ended with, as in [Results](#results)",
}

_PROGRESS: Mapping[str, str] = {
    "phase": "part of the motion",
    "step": "steps so far",
    "total_steps": "steps that are expected; 0 where nobody can know",
    "command_rad": "where the jaws are led to",
    "position_rad": "where they are",
    "torque_nm": "the motor's torque",
    "coil_temperature_c": "the coil's temperature",
}

_OWN, _LEADERS, _LINK = "own", "leader's", "link"
TELEOP: Mapping[str, tuple[str, str]] = {
    "active": (_OWN, "whether it runs; else all is as at the end of the last one"),
    "mode": (_OWN, "this end; null: there was none so far"),
    "phase": (
        _OWN,
        "a leader: waiting (it holds), leading; else waiting, aligning, following, stale, released",
    ),
    "topic": (_LINK, "the key of the frames"),
    "link": (_LINK, "how frames travel"),
    "host": (_LINK, "a slave's leader; with udp also whom a master sends to"),
    "port": (
        _LINK,
        "the leader's port, with udp the follower's; null where a client or nobody has a network",
    ),
    "link_state": (_LINK, "of this end alone: open does not say that somebody is there"),
    "link_error": (_LINK, "why it failed; it is tried again every second"),
    "link_protected": (
        _LINK,
        "false: whoever reaches it can take part; null: not open, or a client's",
    ),
    "link_reach": (
        _LINK,
        "a slave: resolving (its leader), connecting, connected, frames; udp: bound or sending",
    ),
    "link_unreached": (
        _LINK,
        "why the other end is not reached, and for how long; null: no reason",
    ),
    "matching": (_LINK, "a master over zenoh: whether anybody listens; null: nobody can know"),
    "frames": (_OWN, "sent by a master, followed by a slave"),
    "last_frame_age_ms": (_OWN, "since the newest of them was sent, or came"),
    "stale": (_OWN, "a slave: no frame for watchdog_s"),
    "openness": (_LEADERS, "0 closed to 1 open, in the newest frame; 0 before it"),
    "position_mm": (_LEADERS, "opening, in the newest frame; 0 before it"),
    "force_n": (_LEADERS, "squeezing positive, in the newest frame; 0 before it"),
    "dq_cmd": (_OWN, "a slave: velocity that is fed forward, rad/s"),
    "loop_hz": (_OWN, "control loop"),
    "rejected": (_OWN, "payloads that were no frame"),
    "out_of_order": (_OWN, "frames that were overtaken"),
    "other_leaders": (_OWN, "frames of a second leader, or of a clock that was set back"),
    "dropped": (_LINK, "more than any leader sends, or from whom nobody listens to"),
    "send_failed": (_OWN, "frames that did not leave; a slave: commands without an answer"),
    "fault": (_OWN, "the motor's status where it is not enabled, or why it all ended; else empty"),
    "torque_nm": (_OWN, "this gripper's motor"),
    "over_torque": (_OWN, "a slave: the torque guard has let go"),
    "torque_trips": (_OWN, "a slave: how often it has"),
    "ready": (
        _OWN,
        "a slave: it follows, its jaws are where the leader's are; a master: a slave has said so",
    ),
    "ready_rx": (_OWN, "a master: ready bytes that have come"),
    "ready_pubs": (_OWN, "a slave: ready bytes that it has sent"),
    "ready_timed_out": (_OWN, "a master: no slave was ready in time, and the jaws went slack"),
    "force_limited": (
        _OWN,
        "a slave would press harder, but for `force_limit_n` or the cap that every follower has",
    ),
    "reflects": (_OWN, "whether this end asked for force reflection"),
    "reflected_n": (
        _OWN,
        "a slave: what it reported last, null if no leader is heard; a master: what it pushes with",
    ),
    "followers": (_OWN, "a master with reflection: whose force is heard now"),
    "round_trip_ms": (_OWN, "a master with reflection: age of the position that is answered"),
    "late": (_OWN, "frames kept by a network that was silent; a master: forces that came too late"),
    "job": (_OWN, "the job's number"),
}


def notifications_section() -> str:
    """Make the section on what comes without being an answer."""
    rows = ((f"`{kind.name}`", kind.summary, PARAMS[kind.name]) for kind in NOTIFICATIONS)
    return _section(
        "## Notifications",
        "Lines of the daemon's with a `method` and no `id`: `params` has these members.",
        _table(("method", "for", "params"), rows),
    )


def results_section() -> str:
    """Make the section on what motions end with."""
    parts = [
        _section(
            "## Results",
            "A motion's result has `job`, the fields of its kind, and `state`, the"
            " [state](#the-state) in which it ended.",
        )
    ]
    for kind in get_args(Result):
        hints = get_type_hints(kind)
        rows = ((f"`{name}`", type_name(hint)) for name, hint in hints.items())
        title = f"### `{kind.__name__}`"
        parts.append(_section(title, _about(kind), _table(("field", "type"), rows)))
    return "\n".join(parts)


def jobs_section() -> str:
    """Make the sections on jobs and their progress."""
    job = _table(("field", "what it is"), ((f"`{name}`", text) for name, text in JOB.items()))
    own = [
        ("`job`", "integer", "the job's number"),
        ("`request`", "string, or integer", "the `id` of the request that wants it"),
        ("`kind`", "string", "as the job's"),
        ("`opening_mm`", "number, or null", "opening"),
    ]
    hints = get_type_hints(Progress)
    own += [(f"`{field}`", type_name(hints[field]), _PROGRESS[field]) for field in hints]
    more = [field.name for field in fields(ReplayProgress) if field.name not in hints]
    replay = ", ".join(f"`{name}`" for name in more)
    progress = _table(("field", "type", "meaning"), own)
    return "\n".join(
        (
            _section("## Jobs", "What `job.get`, `job.wait` and `job.list` tell of one.", job),
            _section("## Progress", "The `params` of `job.progress`.", progress),
            _section(
                f"A replay's has {replay}, too: what the path has now, and what `ReplayResult`"
                " counts, so far."
            ),
        )
    )


def teleop_section() -> str:
    """Make the section on the status of teleoperation."""
    hints = get_type_hints(TeleopStatus)
    rows = (
        (f"`{name}`", type_name(hint), TELEOP[name][0], TELEOP[name][1])
        for name, hint in hints.items()
    )
    return _section(
        "## The status of teleoperation",
        "Whose a figure is: *own*, this gripper's or this end's; *leader's*, of the gripper that"
        " leads, which is the own one at the leader and another one at a follower; *link*, the"
        " link's. Counts begin anew with every `teleop.start`.",
        _table(("field", "type", "whose", "meaning"), rows),
    )


def state_section() -> str:
    """Make the section on the state."""
    rows = ((f"`{name}`", type_name(hint)) for name, hint in get_type_hints(GripperState).items())
    modes = ((f"`{mode}`", MODES[mode]) for mode in get_args(Mode))
    return _section(
        "## The state",
        _about(GripperState),
        _table(("field", "type"), rows),
        _table(("mode", "meaning"), modes),
    )


def result_form(method: Method) -> str:
    """Name the forms of a method's result."""
    schema = dict(result_schema(method, Schemas(FORMS)))
    del schema["type"]
    return _form_name(schema)


def forms_section() -> str:
    """Make the section on the forms of answers and notifications that no other section has."""
    told = {GripperState, TeleopStatus, Progress, ReplayProgress, *get_args(Result)}
    names = {kind.__name__ for kind in told} | {"Job", "PartialState"}
    forms = Schemas(FORMS)
    methods = (*METHODS, *SIMULATED_METHODS)
    for sent in (*(row.returns for row in methods), *(kind.params for kind in NOTIFICATIONS)):
        forms.of(sent)
    rows = (
        (f"`{name}`", "; ".join(_members(form)) or "none")
        for name, form in forms.definitions.items()
        if name not in names
    )
    text = (
        "What `rpc.discover` has as JSON Schema. A member marked (optional) need not be there. The"
        " forms of the state, of a job, its result and progress, and of the status of"
        " teleoperation are described above; a `PartialState` has some fields of the state."
    )
    return _section("## Forms", text, _table(("form", "members"), rows))


def _members(form: Schema) -> Iterable[str]:
    for name, schema in form["properties"].items():
        yield f"`{name}`{'' if name in form['required'] else ' (optional)'}: {_form_name(schema)}"


def _form_name(schema: Mapping[str, Any]) -> str:
    """Name what a schema describes."""
    if "$ref" in schema:
        return f"`{schema['$ref'].removeprefix(REFERENCE)}`"
    if "anyOf" in schema:
        return ", or ".join(map(_form_name, schema["anyOf"]))
    if "enum" in schema:
        return ", ".join(json.dumps(choice) for choice in schema["enum"])
    kinds = schema.get("type", "anything")
    if kinds == "array":
        return f"array of {_form_name(schema['items'])}"
    return kinds if isinstance(kinds, str) else ", or ".join(kinds)


def type_name(hint: Any) -> str:
    """Name a type as JSON knows it; the names do not depend on Python's version."""
    if get_origin(hint) is Literal:
        return ", ".join(f'"{choice}"' for choice in get_args(hint))
    if get_origin(hint) is tuple:
        return "array of numbers" if float in get_args(hint) else "array of strings"
    if get_origin(hint) in (Union, UnionType):
        return ", or ".join(map(type_name, get_args(hint)))
    return _JSON_NAMES.get(hint, "object")


def _about(kind: type) -> str:
    return re.sub(r"\bNone\b", "null", inspect.getdoc(kind) or "")


def _section(*parts: str) -> str:
    return "\n\n".join(parts) + "\n"


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
