"""Stops, however they are spelt: whoever asks for one gets one."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from litegripd.model.jobs import STOP_LEVELS, StopLevel
from litegripd.rpc.wire import MAX_CONTAINERS, MAX_LINE_BYTES, RequestId, parse

_LEVELS: Mapping[str, StopLevel] = {level: level for level in STOP_LEVELS}
_WHY_CHARACTERS = 80
_LAST_STOPS = 32
"""So many stops that a client has left behind are read; who needs more has a socket for stops."""


@dataclass(frozen=True, slots=True)
class StopLine:
    """What a line asks for, and the id to answer it with."""

    level: StopLevel
    why: str | None = None
    identity: RequestId = None


def stop_in(line: bytes) -> StopLine:
    """Read a line of the stop socket: a level's bare name, a request `stop`, else a `hold`.

    Never raises, whatever the bytes are. A line that says something else is its own reason; a
    reason that cannot be shown is left out.
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

    A level that there is not, or that cannot be read, is a `hold`. Never raises.
    """
    if b"stop" not in line and b"\\" not in line:
        return None
    if line.count(b"{") + line.count(b"[") > MAX_CONTAINERS or len(line) > MAX_LINE_BYTES:
        return None  # it would take long to read
    try:
        value = json.loads(line.decode(errors="replace"))
    except (ValueError, RecursionError):
        return None
    for one in value if isinstance(value, list) else [value]:
        if isinstance(one, dict) and one.get("method") == "stop":
            return _stop_of(one.get("params"))
    return None


def stops_in(text: bytes) -> list[bytes]:
    """Return the lines that ask for a stop among those that a client has left behind.

    Few are read, plainly spelt ones before those that only may be stops.
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
    """Return a reason as one short line; None where there is nothing that can be shown."""
    text = text.strip()
    return text[:_WHY_CHARACTERS] if text.isprintable() and text else None
