"""Values in a form that JSON carries from one process of the daemon to its successor, and back.

What arrives is checked against the declared type, down to the last field. A state that another
version has written, or that is damaged, is rejected; nothing is guessed.

A class with state that must survive a restart declares each attribute. A successor takes over what
the class body declares as `name: Carried[float]`; `NOT_CARRIED` names the others. An attribute in
neither is a defect. It is found before anything is handed over.
"""

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from litegripd.model.sentence import Sentence, Term

TYPE_KEY = "is"
"""The key of an object's class name; no field has this name."""


class PlainError(ValueError):
    """A value that is not of the declared type; the message says where."""


def plain_of(value: Any) -> Any:
    """Return a value in a form that JSON can hold: dataclasses as objects, enums by their names.

    Numbers that are not finite stay: both ends use Python's own `json`.
    """
    if type(value) in _AS_THEY_ARE:
        return value
    if isinstance(value, Sentence) and value.terms:
        return {TYPE_KEY: Sentence.__name__, "text": str(value), "terms": value.terms}
    if value is None or isinstance(value, bool | int | float | str):
        return value.name if isinstance(value, Enum) else value
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, Mapping):
        return {str(key): plain_of(item) for key, item in value.items()}
    if isinstance(value, tuple | list | deque):
        return [plain_of(item) for item in value]
    if is_dataclass(value):
        owner: type = type(value)
        plain: dict[str, Any] = {TYPE_KEY: owner.__name__}
        for name in _fields_of(owner):
            plain[name] = plain_of(getattr(value, name))
        return plain
    raise PlainError(f"a {type(value).__name__} cannot be handed over")


_AS_THEY_ARE = frozenset((NoneType, bool, int, float, str))
"""Nothing commands the motor while its state is made plain: most values end here."""


@cache
def _fields_of(owner: type) -> tuple[str, ...]:
    """Return the names of a dataclass's fields."""
    return tuple(field.name for field in fields(owner))


def value_of(plain: Any, kind: Any, where: str) -> Any:
    """Return the value of the declared type `kind`; `where` names it in an error.

    Raises `PlainError`, also for a value that its own class rejects.
    """
    return _reader(kind)(plain, where)


Reader = Callable[[Any, str], Any]


@cache
def _reader(kind: Any) -> Reader:
    """Return the function that reads a type; made once for each type."""
    if kind in _READERS:
        return _READERS[kind]
    if kind in _PRIMITIVES:
        return _primitive(kind)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return _union(arguments)
    if origin is Literal:
        return _literal(arguments)
    if origin is tuple:
        return _tuple(arguments)
    if origin is deque:
        return _sequence(arguments[0], deque)
    if origin in (Mapping, dict) or (origin and issubclass(origin, Mapping)):
        return _mapping(*arguments)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _enum(kind)
    if is_dataclass(kind):
        return _dataclass(kind)
    raise TypeError(f"{kind} cannot be handed over")


_PRIMITIVES: Mapping[Any, tuple[type, ...]] = {
    NoneType: (NoneType,),
    bool: (bool,),
    int: (int,),
    float: (float, int),
    str: (str,),
}


def _primitive(kind: Any) -> Reader:
    allowed = _PRIMITIVES[kind]

    def read(plain: Any, where: str) -> Any:
        if type(plain) not in allowed:
            raise PlainError(f"{where} is a {type(plain).__name__}, not a {kind.__name__}")
        return plain

    return read


def _sentence(plain: Any, where: str) -> Sentence:
    check_object(plain, Sentence.__name__, {TYPE_KEY, "text", "terms"}, where)
    rows = value_of(plain["terms"], tuple[tuple[int, int, str | None, str | None], ...], where)
    return Sentence(value_of(plain["text"], str, where), [Term(*row) for row in rows])


def _as_it_is(plain: Any, _where: str) -> Any:
    return plain


_READERS: Mapping[Any, Reader] = {Any: _as_it_is, object: _as_it_is, Sentence: _sentence}


def _union(members: tuple[Any, ...]) -> Reader:
    classes: list[Any] = [member for member in members if is_dataclass(member)]
    named = {member.__name__: _reader(member) for member in classes}
    primitives = [member for member in members if member in _PRIMITIVES]
    allowed = {kind for member in primitives for kind in _PRIMITIVES[member]}
    others = [_reader(one) for one in members if one not in classes and one not in primitives]

    def read(plain: Any, where: str) -> Any:
        if type(plain) in allowed:
            return plain
        name = plain.get(TYPE_KEY) if isinstance(plain, dict) else None
        if isinstance(name, str) and name in named:
            return named[name](plain, where)
        for other in others:
            with suppress(PlainError):
                return other(plain, where)
        raise PlainError(f"{where} is none of what it may be: {plain!r:.80}")

    return read


def _literal(choices: tuple[Any, ...]) -> Reader:
    def read(plain: Any, where: str) -> Any:
        if not isinstance(plain, str | int) or plain not in choices:
            raise PlainError(f"{where} is {plain!r:.80}, none of {choices}")
        return plain

    return read


def _tuple(arguments: tuple[Any, ...]) -> Reader:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return _sequence(arguments[0], tuple)
    members = [_reader(argument) for argument in arguments]

    def read(plain: Any, where: str) -> Any:
        if not isinstance(plain, list) or len(plain) != len(members):
            raise PlainError(f"{where} is not a row of {len(members)}")
        return tuple(member(item, where) for member, item in zip(members, plain, strict=True))

    return read


def _sequence(kind: Any, make: Callable[[Any], Any]) -> Reader:
    member = _reader(kind)

    def read(plain: Any, where: str) -> Any:
        if not isinstance(plain, list):
            raise PlainError(f"{where} is not an array")
        return make(member(item, where) for item in plain)

    return read


def _mapping(key_kind: Any, kind: Any) -> Reader:
    member = _reader(kind)

    def read(plain: Any, where: str) -> Any:
        if not isinstance(plain, dict):
            raise PlainError(f"{where} is not an object")
        try:
            return {key_kind(key): member(item, f"{where}.{key}") for key, item in plain.items()}
        except PlainError:
            raise
        except ValueError as error:
            raise PlainError(f"{where}: {error}") from None

    return read


def _enum(kind: type[Enum]) -> Reader:
    def read(plain: Any, where: str) -> Any:
        if not isinstance(plain, str) or plain not in kind.__members__:
            raise PlainError(f"{where} is {plain!r:.80}, no {kind.__name__}")
        return kind[plain]

    return read


def _dataclass(kind: Any) -> Reader:
    hints = get_type_hints(kind)
    members = {field.name: _reader(hints[field.name]) for field in fields(kind)}
    expected = {TYPE_KEY, *members}

    def read(plain: Any, where: str) -> Any:
        check_object(plain, kind.__name__, expected, where)
        values = {name: member(plain[name], f"{where}.{name}") for name, member in members.items()}
        try:
            return kind(**values)
        except (ValueError, KeyError) as error:
            raise PlainError(f"{where}: {error}") from None

    return read


def check_object(plain: Any, name: str, expected: set[str], where: str) -> None:
    """Reject what is not the object `name` with exactly the expected keys."""
    if not isinstance(plain, dict) or plain.get(TYPE_KEY) != name:
        raise PlainError(f"{where} is not a {name}")
    differing = expected ^ plain.keys()
    if differing:
        raise PlainError(f"{where}: a {name} of another version, by {', '.join(sorted(differing))}")


_Type = TypeVar("_Type")
_CARRIED = "carried"

Carried = Annotated[_Type, _CARRIED]
"""The type of an attribute that a successor takes over, declared in the body of its class."""


@cache
def carried_by(owner: type) -> Mapping[str, Any]:
    """Return the carried attributes of a class, with their types."""
    hints = get_type_hints(owner, include_extras=True)
    return {
        name: hint.__origin__
        for name, hint in hints.items()
        if _CARRIED in getattr(hint, "__metadata__", ())
    }


def undeclared(source: object) -> set[str]:
    """Return the attributes of an object that its class declares neither carried nor not carried.

    Attributes that it declares twice, and those that the object does not have, are included.
    """
    owner: type = type(source)
    once, twice = _declared_by(owner)
    own = vars(source).keys()
    if own == once and not twice:
        return set()
    missing = {name for name in once if not hasattr(source, name)}
    return (own - once) | twice | missing


@cache
def _declared_by(owner: type) -> tuple[frozenset[str], frozenset[str]]:
    """Return the attributes that a class declares, and those that it declares twice."""
    carried, left = carried_by(owner).keys(), set(getattr(owner, "NOT_CARRIED", ()))
    return frozenset(carried | left), frozenset(carried & left)


def memory(source: object) -> dict[str, Any]:
    """Return the carried attributes as JSON can hold them. Raises `PlainError` for a defect."""
    owner: type = type(source)
    unknown = undeclared(source)
    if unknown:
        names = ", ".join(sorted(unknown))
        raise PlainError(f"of {owner.__name__} it is not said who takes over: {names}")
    plain: dict[str, Any] = {TYPE_KEY: owner.__name__}
    for name, kind in carried_by(owner).items():
        value = getattr(source, name)
        plain[name] = memory(value) if is_stateful(kind) else plain_of(value)
    return plain


@cache
def _readers_of(owner: type) -> Mapping[str, Reader | None]:
    """Return what reads each carried attribute; None for one with carried attributes of its own."""
    kinds = carried_by(owner)
    return {name: None if is_stateful(kind) else _reader(kind) for name, kind in kinds.items()}


def restore(
    target: object, plain: Any, where: str = "", known: Mapping[str, Any] | None = None
) -> None:
    """Fill `target` with what `memory` returned. Raises `PlainError` for anything else.

    An object with carried attributes of its own is filled, not replaced. Bounded collections are
    filled, too, so that they keep their bounds. `known` is what `target` was filled with before,
    if it has not changed since: what is the same in both is left as it is.
    """
    owner: type = type(target)
    where, readers = where or owner.__name__, _readers_of(owner)
    check_object(plain, owner.__name__, {TYPE_KEY, *readers}, where)
    for name, read in readers.items():
        if known is not None and known[name] == plain[name]:
            continue
        present, inner = getattr(target, name), f"{where}.{name}"
        if read is None:
            restore(present, plain[name], inner, None if known is None else known[name])
            continue
        value = read(plain[name], inner)
        if isinstance(present, deque):
            present.clear()
            present.extend(value)
        else:
            setattr(target, name, value)


@cache
def is_stateful(kind: Any) -> bool:
    """Return True if a type is a class with carried attributes."""
    return get_origin(kind) is None and isinstance(kind, type) and bool(carried_by(kind))
