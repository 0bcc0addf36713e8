"""What portal and gateway say beside the daemon's lines: the small JSON attached to each message.

What arrives may be anything: it is checked down to each member, and anything else is refused.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

VERSION = 1
LONGEST_BYTES = 2048
_MOST = 2**53

Op = Literal["open", "line", "eof", "live", "lives", "close"]


class BadMessageError(ValueError):
    """What arrived is no message; the text says why."""


@dataclass(frozen=True, slots=True)
class Ask:
    """From a portal, with a query: a session's beginning, a line, their end, its life, or its end.

    `number` is the line's, or their end's, from 1; `got` the last push that arrived in order;
    `again` asks for what follows it once more. `at_s` is when the line or the sign of life was
    sent, by the portal's reckoning of the gateway's CLOCK_MONOTONIC, `generation` the count of
    stops that the portal knew of then. `ttl_s`, `program` and `process` come with `open`: the
    client's name, and a word that no other process of any machine has; so does `together`, by
    which name a portal takes what is said of many sessions at once (`wire.together`). `lives` is
    the one message of no session: its payload has the sessions that live.
    """

    op: Op
    number: int = 0
    got: int = 0
    again: bool = False
    at_s: float | None = None
    generation: int | None = None
    ttl_s: float | None = None
    program: str | None = None
    process: str | None = None
    together: str | None = None


@dataclass(frozen=True, slots=True)
class Reply:
    """To an `Ask`: the last line that was taken, the last push that was sent, and the time.

    `gone` is the error that ended the session, or that kept it from beginning; `about` comes with
    the answer to `open`.
    """

    took: int
    sent: int
    now_s: float
    generation: int | None = None
    gone: dict[str, Any] | None = None
    about: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Push:
    """From a gateway: a line of the daemon, or a piece of a long one, `more` of which follows.

    A sample that a newer one replaces has no `number`: it is not sent twice. `end`: the daemon has
    closed the connection, and this was the last.
    """

    number: int | None
    more: bool = False
    end: bool = False
    generation: int | None = None


_Message = TypeVar("_Message", bound=Ask | Reply | Push)

_KINDS: tuple[type[Ask | Reply | Push], ...] = (Ask, Reply, Push)
_DEFAULTS: Mapping[type, Mapping[str, Any]] = {
    kind: {field.name: field.default for field in fields(kind)} for kind in _KINDS
}
_HINTS: Mapping[type, Mapping[str, Any]] = {kind: get_type_hints(kind) for kind in _KINDS}


def packed(message: Ask | Reply | Push) -> bytes:
    """Return a message as it travels; what has its default is left out."""
    own = {
        name: value
        for name, default in _DEFAULTS[type(message)].items()
        if (value := getattr(message, name)) != default
    }
    return json.dumps({"v": VERSION, **own}, separators=(",", ":")).encode()


def unpacked(kind: type[_Message], attached: bytes | None) -> _Message:
    """Return the message that was attached; raises `BadMessageError`."""
    if attached is None or len(attached) > LONGEST_BYTES:
        raise BadMessageError(f"a message has an attachment of at most {LONGEST_BYTES} bytes")
    try:
        value = json.loads(attached)
    except (ValueError, RecursionError) as error:
        raise BadMessageError(f"the attachment is not JSON: {error}") from error
    if not isinstance(value, dict):
        raise BadMessageError("the attachment is no object")
    if value.pop("v", None) != VERSION:
        raise BadMessageError(f"only version {VERSION} is spoken here")
    hints = _HINTS[kind]
    # A newer minor version may say more; it is not understood, and not needed.
    known = {name: item for name, item in value.items() if name in hints}
    for name, item in known.items():
        if not _fits(item, hints[name]):
            raise BadMessageError(f"{name} cannot be {item!r:.40}")
    try:
        return kind(**known)
    except TypeError as error:
        raise BadMessageError(f"something is missing: {error}") from error


def _fits(value: object, kind: Any) -> bool:
    options = get_args(kind)
    if get_origin(kind) is Literal:
        return isinstance(value, str) and value in options
    if NoneType in options:
        return value is None or any(_fits(value, one) for one in options if one is not NoneType)
    if kind is float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and abs(value) < _MOST  # type: ignore[arg-type] # NaN is not
    if kind is int:
        return type(value) is int and 0 <= value < _MOST
    if kind is str:
        return isinstance(value, str) and value.isprintable() and len(value) <= 64
    if get_origin(kind) is dict:
        return isinstance(value, Mapping)
    return isinstance(value, kind)
