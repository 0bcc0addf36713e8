"""The parameters of methods and the types of answers, from one definition each.

Parameters are checked, and described by JSON Schema. So is what the daemon sends, by the declared
types of its values.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import (
    Any,
    Literal,
    TypeAlias,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

from litegripd.model.errors import Refusal
from litegripd.model.motor_types import MotorType

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
            return f"must be {_NAMED[self.kind]}, not {_shown(value)}"
        if isinstance(value, int | float) and not isinstance(value, bool):
            return self._problem_of_number(value)
        texts = value if isinstance(value, list) else [value] if isinstance(value, str) else []
        return next(filter(None, map(self._problem_of_text, texts)), None)

    def _problem_of_number(self, value: float) -> str | None:
        if isinstance(value, int) and abs(value) > _MAX_INTEGER:
            return f"is {_shown(value)}, it must lie within ±2^53"
        if not math.isfinite(value):
            return f"must be a finite number, not {value}"
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
        if self.minimum is None:
            return f"at most {self.maximum:g}"
        if self.maximum is None:
            return f"at least {self.minimum:g}"
        return f"{self.minimum:g} to {self.maximum:g}"


def check(method: str, declared: Mapping[str, Param], given: Mapping[str, Any]) -> Refusal | None:
    """Return a refusal for a parameter that is unknown, missing, mistyped or out of range."""
    for name, value in given.items():
        param = declared.get(name)
        if param is None:
            allowed = ", ".join(declared) or "none"
            text = f"{method} has no parameter {_shown(name)}; it has: {allowed}"
            return Refusal("invalid_params", text, {"parameter": name[:64]})
        problem = param.problem(value)
        if problem is not None:
            text = f"{method}: {name} {problem}"
            return Refusal("invalid_params", text, {"parameter": name})
    for name, param in declared.items():
        if param.required and name not in given:
            text = f"{method} needs the parameter {param.name}: {param.description}"
            return Refusal("invalid_params", text, {"parameter": param.name})
    return None


def _shown(value: object) -> str:
    if isinstance(value, list | dict):
        return "an array" if isinstance(value, list) else "an object"
    text = repr(value)
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
        return {**schema, "additionalProperties": False} if _is_closed(kind) else schema


def _members(kind: Any) -> dict[str, tuple[Any, bool]]:
    """Return each member's type, and whether it is always there."""
    if isinstance(kind, Shape):
        found = {name: row for part in kind.parts for name, row in _members(part).items()}
        return {name: (hint, due and not kind.partial) for name, (hint, due) in found.items()}
    hints = get_type_hints(kind)
    if is_typeddict(kind):
        return {name: (hint, name in kind.__required_keys__) for name, hint in hints.items()}
    return {field.name: (hints[field.name], True) for field in fields(kind)}


def _is_closed(kind: Any) -> bool:
    return isinstance(kind, Shape) and kind.closed
