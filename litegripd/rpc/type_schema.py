"""JSON Schema of what the daemon sends, made from the types that its values are declared with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
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
    """An object that has the members of several types, and a name of its own.

    With `partial` it may have any of them, and need not have one. With `closed` it never has
    others: alternatives of an answer are told apart by that. All else may grow.
    """

    name: str
    parts: tuple[Any, ...]
    partial: bool = False
    closed: bool = False


class Schemas:
    """Makes schemas; an object with a name is defined once in `definitions`, and referred to.

    `wire` says for a type which other one, or which `Shape`, it has on the wire.
    """

    def __init__(self, wire: Mapping[Any, Any]) -> None:
        self.definitions: dict[str, Schema] = {}
        self._wire = wire
        self._defined: dict[str, Any] = {}

    def of(self, kind: Any) -> Schema:
        """Return the schema of a type, or of a tuple of alternatives.

        Raises `TypeError` for a type that JSON has no form for.
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
    """Return the type of each member of an object, and whether it is always there."""
    if isinstance(kind, Shape):
        found = {name: row for part in kind.parts for name, row in _members(part).items()}
        return {name: (hint, due and not kind.partial) for name, (hint, due) in found.items()}
    hints = get_type_hints(kind)
    if is_typeddict(kind):
        return {name: (hint, name in kind.__required_keys__) for name, hint in hints.items()}
    return {field.name: (hints[field.name], True) for field in fields(kind)}


def _is_closed(kind: Any) -> bool:
    return isinstance(kind, Shape) and kind.closed
