"""A method: its row, its parameters and answers from one definition each, and its request.

Parameters are checked, and described by JSON Schema. So is what the daemon sends, by the declared
types of its values.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import (
    Any,
    Literal,
    NamedTuple,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

from litegripd.control.admission import conflict_refusal
from litegripd.control.calibration import Terms
from litegripd.control.controller import Controller
from litegripd.control.events import NOW, Turn, doubted
from litegripd.control.limiter import Gains
from litegripd.model.calibration import (
    GIVEN_KEYS,
    Calibration,
    CalibrationError,
    of_stroke,
    read_given,
    scale_doubt,
)
from litegripd.model.errors import Refusal, as_typed, unit_of
from litegripd.model.gripper import DM4310, MotorType
from litegripd.model.motion_config import (
    MOVING_KD_NM_S_RAD,
    MOVING_KP_NM_RAD,
    REACHING_KP_NM_RAD,
    MotionConfig,
    MotionConfigError,
    damping_conflict,
    ranges_of,
)
from litegripd.model.sentence import method_name, parameter_name, sentence
from litegripd.model.state import Job, Owner
from litegripd.rpc.reports import JobNumber
from litegripd.rpc.sessions import Role, Session

# Parameters ---------------------------------------------------------------------------------------

Kind: TypeAlias = Literal["number", "integer", "boolean", "string", "strings", "object"]

_MAX_TEXT = 256
_MAX_INTEGER = 2**53  # most JSON readers lose digits beyond it
_JSON_TYPES: dict[Kind, str] = {"strings": "array"}
_NAMED: dict[Kind, str] = {
    "number": "a number",
    "integer": "an integer",
    "boolean": "true or false",
    "string": "a string",
    "strings": "an array of strings only",
    "object": "an object",
}


@dataclass(frozen=True, slots=True)
class Param:
    """One parameter of a method; `minimum` and `maximum` are included in the range.

    A text has at most `longest` characters. If the maximum depends on the motor, `maximum_of`
    returns it, and `maximum` is that of the usual type.
    """

    name: str
    kind: Kind
    description: str
    required: bool = False
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    longest: int = _MAX_TEXT
    maximum_of: Callable[[MotorType], float] | None = None

    def with_motor(self, motor_type: MotorType) -> "Param":
        """Return the parameter for a type of motor."""
        maximum = self.maximum if self.maximum_of is None else self.maximum_of(motor_type)
        return self if maximum == self.maximum else replace(self, maximum=maximum)

    def problem(self, value: object) -> str | None:
        """Return what is wrong with `value` and what is allowed, or None."""
        if not self._has_type(value):
            return self._unlike(value)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return self._problem_of_number(value)
        texts = value if isinstance(value, list) else [value] if isinstance(value, str) else []
        return next(filter(None, map(self._problem_of_text, texts)), None)

    def _unlike(self, value: object) -> str:
        """Return what a value of another type is, or which item of an array is none."""
        named = _NAMED[self.kind]
        if self.kind != "strings" or not isinstance(value, list):
            return f"is {_shown(value)}, it must be {named}"
        item = next(_shown(one) for one in value if not isinstance(one, str))
        return f"must be {named}, and has {item} in it"

    def _problem_of_number(self, value: float) -> str | None:
        if isinstance(value, int) and abs(value) > _MAX_INTEGER:
            return f"is {_shown(value)}, it must lie within ±2^53"
        if not math.isfinite(value):
            return f"is {value}, it must be a finite number"
        low, high = self.minimum, self.maximum
        if (low is not None and value < low) or (high is not None and value > high):
            return f"is {_shown(value)}, it must be {self._range()}"
        return None

    def _problem_of_text(self, text: str) -> str | None:
        if self.choices and text not in self.choices:
            return f"is {_shown(text)}, it must be one of: {', '.join(self.choices)}"
        if len(text) > self.longest:
            return f"is longer than {self.longest} characters"
        if not text.isprintable():
            return f"is {_shown(text)}, it must be printable: it is shown in one line of the log"
        return None

    def json_schema(self) -> dict[str, object]:
        """Return a JSON Schema of the values."""
        schema: dict[str, object] = {"type": _JSON_TYPES.get(self.kind, self.kind)}
        if self.kind == "strings":
            schema["items"] = {"type": "string", **self._text_limits()}
        elif self.kind == "string":
            schema |= self._text_limits()
        if self.minimum is not None:
            schema["minimum"] = self.minimum
        if self.maximum is not None:
            schema["maximum"] = self.maximum
        return schema

    def _text_limits(self) -> dict[str, object]:
        """Return a schema of the accepted texts; JSON Schema counts characters, too."""
        return {"enum": list(self.choices)} if self.choices else {"maxLength": self.longest}

    def _has_type(self, value: object) -> bool:
        if self.kind == "boolean":
            return isinstance(value, bool)
        if self.kind == "string":
            return isinstance(value, str)
        if self.kind == "object":
            return isinstance(value, dict)
        if self.kind == "strings":
            return isinstance(value, list) and all(isinstance(item, str) for item in value)
        if isinstance(value, bool):
            return False
        return isinstance(value, int if self.kind == "integer" else int | float)

    def _range(self) -> str:
        unit = unit_of(self.name)
        if self.minimum is None:
            return f"at most {_limit(self.maximum)}{unit}"
        if self.maximum is None:
            return f"at least {_limit(self.minimum)}{unit}"
        return f"{_limit(self.minimum)} to {_limit(self.maximum)}{unit}"


def check(method: str, declared: Mapping[str, Param], given: Mapping[str, Any]) -> Refusal | None:
    """Return a refusal for a parameter that is unknown, missing, mistyped or out of range.

    By the words for what is unknown a newer client finds that this daemon is older.
    """
    for name, value in given.items():
        param = declared.get(name)
        if param is None:
            text = sentence(
                "{method} has no parameter {given}; it has: {allowed}",
                method=method_name(method),
                given=_shown(name),
                allowed=", ".join(declared) or "none",  # unmarked: so many take too long
            )
            return Refusal("invalid_params", text, {"parameter": name[:64]})
        problem = param.problem(value)
        if problem is not None:
            text = sentence(
                "{method}: {name} {problem}",
                method=method_name(method),
                name=parameter_name(name),
                problem=problem,
            )
            return Refusal("invalid_params", text, {"parameter": name})
    for name, param in declared.items():
        if param.required and name not in given:
            text = sentence(
                "{method} needs the parameter {name}: {description}",
                method=method_name(method),
                name=parameter_name(param.name),
                description=param.description,
            )
            return Refusal("invalid_params", text, {"parameter": param.name})
    return None


def _limit(value: float | None) -> str:
    """Return a limit as a person writes it: 1000000, not 1e+06."""
    return str(value) if isinstance(value, int) else f"{value:g}"


def _shown(value: object) -> str:
    if isinstance(value, list | dict):
        return "an array" if isinstance(value, list) else "an object"
    text = as_typed(value)
    return text if len(text) <= 60 else text[:57] + "..."


# What is sent -------------------------------------------------------------------------------------

Schema: TypeAlias = dict[str, Any]

REFERENCE = "#/components/schemas/"

_PRIMITIVES: Mapping[Any, str] = {
    NoneType: "null",
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
}


@dataclass(frozen=True, slots=True)
class Shape:
    """An object with the members of several types, and a name of its own.

    With `partial` it may have any of them, and needs none. With `closed` it never has others: this
    distinguishes the alternatives of an answer. All other types may grow.
    """

    name: str
    parts: tuple[Any, ...]
    partial: bool = False
    closed: bool = False


class Schemas:
    """Makes schemas; an object with a name is defined once in `definitions`, and referred to.

    `wire` maps a type to another one, or to a `Shape`, that it has on the wire.
    """

    def __init__(self, wire: Mapping[Any, Any]) -> None:
        self.definitions: dict[str, Schema] = {}
        self._wire = wire
        self._defined: dict[str, Any] = {}

    def of(self, kind: Any) -> Schema:
        """Return the schema of a type, or of a tuple of alternatives.

        Raises `TypeError` for a type without a form in JSON.
        """
        kind = self._wire.get(kind, kind)
        if isinstance(kind, tuple):
            return self._union(kind)
        if kind in (Any, object):
            return {}
        if kind in _PRIMITIVES:
            return {"type": _PRIMITIVES[kind]}
        if isinstance(kind, Shape) or is_dataclass(kind) or is_typeddict(kind):
            return self._reference(kind)
        origin, arguments = get_origin(kind), get_args(kind)
        if origin is Literal:
            return {"enum": list(arguments)}
        if origin in (Union, UnionType):
            return self._union(arguments)
        if origin is tuple and Ellipsis not in arguments:
            return self._row(kind, arguments)
        if origin in (tuple, list, Sequence):
            return {"type": "array", "items": self.of(arguments[0])}
        if origin in (dict, Mapping) and arguments[0] is str:
            values = self.of(arguments[1])
            return {"type": "object", **({"additionalProperties": values} if values else {})}
        raise TypeError(f"{kind} has no form in JSON")

    def _union(self, members: tuple[Any, ...]) -> Schema:
        schemas = [self.of(member) for member in members]
        if all(schema.keys() == {"type"} for schema in schemas):
            return {"type": [schema["type"] for schema in schemas]}
        return {"anyOf": schemas}

    def _row(self, kind: Any, members: tuple[Any, ...]) -> Schema:
        if len(set(members)) != 1:
            raise TypeError(f"{kind}: only a row of one type has a form")
        length = len(members)
        items = self.of(members[0])
        return {"type": "array", "items": items, "minItems": length, "maxItems": length}

    def _reference(self, kind: Any) -> Schema:
        name = kind.name if isinstance(kind, Shape) else kind.__name__
        if self._defined.setdefault(name, kind) != kind:
            raise TypeError(f"two types are named {name}")
        if name not in self.definitions:
            self.definitions[name] = {}  # it may refer to itself
            self.definitions[name] |= self._object(kind)
        return {"$ref": REFERENCE + name}

    def _object(self, kind: Any) -> Schema:
        members = _members(kind)
        schema: Schema = {
            "type": "object",
            "properties": {name: self.of(hint) for name, (hint, _is_due) in members.items()},
            "required": [name for name, (_hint, is_due) in members.items() if is_due],
        }
        is_closed = isinstance(kind, Shape) and kind.closed
        return {**schema, "additionalProperties": False} if is_closed else schema


def _members(kind: Any) -> dict[str, tuple[Any, bool]]:
    """Return each member's type, and True if it is always there."""
    if isinstance(kind, Shape):
        found = {name: row for part in kind.parts for name, row in _members(part).items()}
        return {name: (hint, due and not kind.partial) for name, (hint, due) in found.items()}
    hints = get_type_hints(kind)
    if is_typeddict(kind):
        return {name: (hint, name in kind.__required_keys__) for name, hint in hints.items()}
    return {field.name: (hints[field.name], True) for field in fields(kind)}


# A request and its answers ------------------------------------------------------------------------


class Refused(Exception):  # noqa: N818 - no error: an answer
    """Raised by a method's function, or by its callees, instead of returning a refusal.

    Not by later callbacks, when a helper process has answered.
    """

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.message)
        self.refusal = refusal


T = TypeVar("T")


def accepted(answer: T | Refusal) -> T:
    """Return the answer; raise `Refused` if it is a refusal."""
    if isinstance(answer, Refusal):
        raise Refused(answer)
    return answer


class Call(NamedTuple):
    """One request with checked parameters; `received_s` is when its line came."""

    session: Session
    owner: Owner
    params: Mapping[str, Any]
    now_s: float
    received_s: float
    turn: Turn = NOW

    @property
    def detached(self) -> bool:
        """True if the motion outlives its connection: as requested, else if not waited for."""
        return bool(self.params.get("detach", not self.params.get("wait", True)))

    def gains(self, base: Gains) -> Gains:
        """Return `base` with the gains that the caller wants, up to the usual ones."""
        if not ("kp" in self.params or "kd" in self.params):
            return base
        kp = self.params.get("kp", base.kp_nm_rad)
        kd = self.params.get("kd", base.kd_nm_s_rad)
        refusal = conflict_refusal(damping_conflict(kp, kd))
        if refusal is not None:
            raise Refused(refusal)
        return Gains(kp, kd).usual()

    def terms(self, controller: Controller) -> Terms:
        """Return what its motion counts on: the daemon's, but for what the caller brings.

        A doubt of the caller's calibration is told once. A stream brings the same one with each
        set-point: it is read once.
        """
        terms, content = controller.terms, self.params.get("calibration")
        if "config" in self.params:
            terms = replace(terms, config=self.config(controller))
        if content is None:
            return terms
        session, stroke_mm = self.session, controller.gripper_id.stroke_mm
        given = session.calibration
        if given is None or given.content != content:
            given = of_stroke(_read(content), stroke_mm)
        terms = accepted(
            controller.calibrated.terms_of(
                given,
                self.owner.client,
                terms.config,
                controller.gripper_id,
                controller.motor.identity,
            )
        )
        if given is session.calibration:
            return terms
        session.calibration, doubt = given, scale_doubt(given, stroke_mm)
        if doubt is not None and doubt not in session.doubts:
            session.doubts.add(doubt)
            controller.events.append(doubted(given, stroke_mm, self.owner))
        return terms

    def config(self, controller: Controller) -> MotionConfig:
        """Return the daemon's configuration with the changes that the caller wants."""
        given, base = self.params.get("config"), controller.config
        if given is None:
            return base
        try:
            return base.changed(given, controller.period_s, controller.gripper_id.motor_type)
        except MotionConfigError as error:
            data = {"parameter": "config", "field": error.field}
            text = sentence("{name}: {error}", name=parameter_name("config"), error=error)
            raise Refused(Refusal("invalid_params", text, data)) from None


def _read(content: Mapping[str, Any]) -> Calibration:
    """Return the calibration that a request brings; raise `Refused` if it cannot be used."""
    try:
        return read_given(content)
    except KeyError as error:
        name = str(error.args[0])[:64]
        text = f"calibration has no key {_shown(name)}; it has: {', '.join(GIVEN_KEYS)}"
        data = {"parameter": "calibration", "field": name}
        raise Refused(Refusal("invalid_params", text, data)) from None
    except CalibrationError as error:
        text, data = f"calibration: {error}", {"parameter": "calibration"}
        raise Refused(Refusal("calibration_unreadable", text, data)) from None


@dataclass(frozen=True, slots=True)
class Later:
    """The answer comes when `job` has ended: its result, or the job itself."""

    job: Job
    wants_job: bool = False


Result: TypeAlias = Mapping[str, Any] | bytes | Refusal


class Deferred:
    """The answer comes with the one call of `resolve`."""

    def __init__(self) -> None:
        self._answer: Result | None = None
        self._on_answer: Callable[[Result], None] | None = None

    def resolve(self, answer: Result) -> None:
        """Give the answer."""
        self._answer = answer
        if self._on_answer is not None:
            self._on_answer(answer)

    def then(self, on_answer: Callable[[Result], None]) -> None:
        """Call `on_answer` with the answer, at once if it has been given already."""
        self._on_answer = on_answer
        if self._answer is not None:
            on_answer(self._answer)


Answer: TypeAlias = Result | Later | Deferred
"""A result now, as a value or as JSON, a refusal, or a later answer."""

Function: TypeAlias = Callable[[Call], Answer]


def later(job: Job | Refusal) -> Answer:
    """Answer when a job has ended, if it has begun."""
    return job if isinstance(job, Refusal) else Later(job)


# Rows ---------------------------------------------------------------------------------------------

COMMON_PARAMS = (
    Param("sent_s", "number", "When the request was sent, seconds of CLOCK_MONOTONIC.", minimum=0),
    Param("stop_generation", "integer", "The count of stops that the sender knew of.", minimum=0),
)
"""Every method takes these; a request from before a stop neither moves nor clears after it."""

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
AT_ONCE = Shape("AtOnce", (JobNumber,), closed=True)
"""The answer of a method that does not wait for the end of its job."""

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
CALIBRATION = Param(
    "calibration",
    "object",
    "A calibration that counts for this call only, and for what it leaves the jaws doing:"
    f" {', '.join(GIVEN_KEYS[:3])}, and if wanted {', '.join(GIVEN_KEYS[3:])}, as in a calibration"
    " file. It is checked as calibration.load checks one (default: the calibration in use).",
)
RUN_PARAMS = (CONFIG, WAIT, PROGRESS, DETACH, IF_BUSY, KEY)
"""What every lasting motion takes."""
MOTION_PARAMS = (CALIBRATION, *RUN_PARAMS)
"""What one takes that goes by a calibration."""

F = TypeVar("F", bound=Callable[..., Answer])
_ROW = "_method"


@dataclass(frozen=True, slots=True)
class Method:
    """One method; put above its function as a decorator.

    `returns` is the type of the final result: its schema is made from it. `role` is the lowest role
    of a caller; `needs_lease` marks methods that only the holder of the lease may call, while there
    is one; `stop_voids` those that a later stop makes void; `waits` those whose answer comes when a
    job has ended; `may_notify` those that may be sent without an id; `lifts_stop` the one that is
    also for the client that has stopped and for admins, with any role and any holder of the lease;
    `of_older` returns what the parameters of an older client are now called.
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
    of_older: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    declared: Mapping[str, Param] = field(init=False)

    def __post_init__(self) -> None:
        """Index the parameters by name."""
        lease = (LEASE,) if self.needs_lease else ()
        declared = {param.name: param for param in (*self.params, *lease, *COMMON_PARAMS)}
        object.__setattr__(self, "declared", declared)

    def __call__(self, function: F) -> F:
        """Attach this row to the function below it, as a decorator."""
        setattr(function, _ROW, self)
        return function

    @property
    def refused_as(self) -> str:
        """The notification that reports the refusal of a request without an id."""
        return f"{self.name.partition('.')[0]}.refused"

    def with_motor(self, motor_type: MotorType) -> "Method":
        """Return the row for a type of motor, which has its own limits."""
        return replace(self, params=tuple(param.with_motor(motor_type) for param in self.params))


@dataclass(frozen=True, slots=True)
class Feature:
    """What a slice adds to the service: objects with methods, and calls at a connection's end."""

    groups: tuple[object, ...]
    session_ended: Callable[[Session], None] = lambda _session: None


def methods_of(group: type) -> tuple[Method, ...]:
    """Return the rows above the functions of a class, in their order."""
    return tuple(row for _name, row in _rows(group))


def functions_of(group: object) -> Mapping[str, Function]:
    """Return the functions of an object that have a row, by their methods' names."""
    return {row.name: getattr(group, name) for name, row in _rows(type(group))}


def _rows(group: type) -> Iterator[tuple[str, Method]]:
    for name, member in vars(group).items():
        row = getattr(member, _ROW, None)
        if isinstance(row, Method):
            yield name, row


def config_param(field: str, description: str, name: str | None = None) -> Param:
    """Return a parameter with the range of a field of the configuration, and its name."""
    low, high = ranges_of(DM4310)[field]
    return Param(
        name or field,
        "number",
        description,
        minimum=low,
        maximum=high,
        maximum_of=lambda motor_type: ranges_of(motor_type)[field][1],
    )


SPEED = config_param("speed_mm_s", "Jaw speed (default: speed_mm_s of the configuration).")


def gain_params(kp: str, kd: str) -> tuple[Param, ...]:
    """Return the parameters of a position command's stiffness and damping, with their defaults."""
    most_kp, most_kd = (
        f"more than {most:g} counts as {most:g}" for most in (MOVING_KP_NM_RAD, MOVING_KD_NM_S_RAD)
    )
    return (
        Param("kp", "number", f"Stiffness, N·m/rad ({kp}; {most_kp}).", minimum=5, maximum=500),
        Param(
            "kd",
            "number",
            f"Damping, at least kp · 0.002 s ({kd}; {most_kd}).",
            minimum=0.1,
            maximum=5,
        ),
    )


def usual_gain_params() -> tuple[Param, ...]:
    """Return those of a motion that reaches its target whatever a calibration's gains are."""
    least = f"less than {REACHING_KP_NM_RAD:g} counts as {REACHING_KP_NM_RAD:g}"
    kp, kd = f"default {MOVING_KP_NM_RAD:g}; {least}", f"default {MOVING_KD_NM_S_RAD:g}"
    return gain_params(kp, kd)


def target_params() -> tuple[Param, ...]:
    """Return the parameters of a target, in one of three quantities."""
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
