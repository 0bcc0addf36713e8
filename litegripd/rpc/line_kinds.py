"""What a line asks for, found before its turn: a stop, in any spelling, or a set-point.

Every request for a stop gets one. Set-points without an id may be many, and are never answered, so
a newer one may replace an older one unread: such a line is recognized without parsing.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from litegripd.model.jobs import STOP_LEVELS, StopLevel
from litegripd.rpc.jsonrpc import MAX_CONTAINERS, MAX_LINE_BYTES, RequestId, parse

# Stops --------------------------------------------------------------------------------------------

_LEVELS: Mapping[str, StopLevel] = {level: level for level in STOP_LEVELS}
_WHY_CHARACTERS = 80
_LAST_STOPS = 32
"""At most this many stops of a lost client are read; a client with more can use the stop socket."""


@dataclass(frozen=True, slots=True)
class StopLine:
    """What a line asks for, and the id to answer it with."""

    level: StopLevel
    why: str | None = None
    identity: RequestId = None


def stop_in(line: bytes) -> StopLine:
    """Read a line of the stop socket: a level's bare name, a request `stop`, else a `hold`.

    Never raises, for any bytes. A line that says something else is its own reason; a reason that
    cannot be shown is left out.
    """
    level = _LEVELS.get(line.strip().lower().decode(errors="replace"))
    if level is not None:
        return StopLine(level)
    request = parse(line)
    asked = asked_stop(line)
    if asked is None:
        return StopLine("hold", _shown(line.decode(errors="replace")), request.identity)
    return replace(asked, identity=request.identity)


def asked_stop(line: bytes) -> StopLine | None:
    """Return the stop that a line asks for by its `method`, well-formed or not; None for others.

    An unknown or unreadable level is a `hold`. Never raises.
    """
    if b"stop" not in line and b"\\" not in line:
        return None
    if line.count(b"{") + line.count(b"[") > MAX_CONTAINERS or len(line) > MAX_LINE_BYTES:
        return None  # it would take too long to read
    try:
        value = json.loads(line.decode(errors="replace"))
    except (ValueError, RecursionError):
        return None
    for one in value if isinstance(value, list) else [value]:
        if isinstance(one, dict) and one.get("method") == "stop":
            return _stop_of(one.get("params"))
    return None


def stops_in(text: bytes) -> list[bytes]:
    """Return the lines that ask for a stop among those of a lost client.

    Few are read; plainly spelt ones come before those that only may be stops.
    """
    if b"stop" not in text and b"\\" not in text:
        return []
    likely = [line for line in text.split(b"\n") if b'"stop"' in line or b"\\" in line]
    likely.sort(key=lambda line: b'"stop"' not in line)
    return [line for line in likely[:_LAST_STOPS] if asked_stop(line) is not None]


def _stop_of(params: Any) -> StopLine:
    named: Iterable[Any] = params if isinstance(params, list) else ()
    if isinstance(params, dict):
        named = (params.get("level"),)
    levels = [_LEVELS[one] for one in named if isinstance(one, str) and one in _LEVELS]
    level: StopLevel = levels[0] if levels else "hold"
    why = params.get("why") if isinstance(params, dict) else None
    return StopLine(level, _shown(why) if isinstance(why, str) else None)


def _shown(text: str) -> str | None:
    """Return a reason as one short line; None if nothing can be shown."""
    text = text.strip()
    return text[:_WHY_CHARACTERS] if text.isprintable() and text else None


# Set-points ---------------------------------------------------------------------------------------

_MARK = b'"stream.set"'
_MOST_BYTES = 512  # longer than a client has reason to write; it is matched in microseconds
_LOOKS = 8  # at most this many lines that only name the method are checked for the newest set-point

_BLANKS = b" \t\r"
_S = rb"[ \t\r]*"
_VALUE = rb'(?:-?\d+(?:\.\d+)?(?:[eE][+-]?\d{1,3})?|"[^"\\\x00-\x1f]*")'
_NAME = (
    rb'"(?:opening_mm|position_rad|openness|valid_s|speed_mm_s|torque_nm|lease|sent_s'
    rb'|stop_generation)"'
)
_MEMBER = _NAME + _S + rb":" + _S + _VALUE + _S
_PARAMS = rb"\{" + _S + rb"(?:" + _MEMBER + rb"(?:," + _S + _MEMBER + rb")*)?\}"
_JSONRPC = rb'"jsonrpc"' + _S + rb":" + _S + rb'"2\.0"'
_METHOD = rb'"method"' + _S + rb":" + _S + _MARK
_ITEM = rb"(?:" + rb"|".join((_JSONRPC, _METHOD, rb'"params"' + _S + rb":" + _S + _PARAMS)) + rb")"
_LINE = re.compile(
    # Three members, and each of the three names: in any order, none is there twice. Blanks around
    # it are stripped before: tried one by one, they would take the square of their number.
    rb"(?=[^\n]*" + _JSONRPC + rb")(?=[^\n]*" + _METHOD + rb')(?=[^\n]*"params")\{'
    + _S + _ITEM + _S + rb"(?:," + _S + _ITEM + _S + rb"){2}\}"
)  # fmt: skip


def is_set_point(line: bytes) -> bool:
    """Return True for a well-formed `stream.set` without an id.

    False for any long or unusually spelt line: such a line is only served one by one.
    """
    if len(line) > _MOST_BYTES or _MARK not in line:
        return False
    return _LINE.fullmatch(line.strip(_BLANKS)) is not None


def newest_set_point(text: bytes, begin: int) -> int:
    """Return where the last whole line from `begin` on starts that is a set-point, or -1."""
    at = text.rfind(_MARK, begin)
    for _ in range(_LOOKS):
        if at < 0:
            break
        start = text.rfind(b"\n", begin, at) + 1 or begin
        end = text.find(b"\n", at)
        if end >= 0 and is_set_point(text[start:end]):
            return start
        at = text.rfind(_MARK, begin, start)
    return -1
