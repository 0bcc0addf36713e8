"""A line of the stop socket, read as what it is in any case: a stop."""

from collections.abc import Mapping
from dataclasses import dataclass

from litegripd.model.jobs import STOP_LEVELS, StopLevel
from litegripd.rpc.wire import BadRequest, RequestId, parse

_LEVELS: Mapping[str, StopLevel] = {level: level for level in STOP_LEVELS}
_WHY_CHARACTERS = 80


@dataclass(frozen=True, slots=True)
class StopLine:
    """What a line asks for, and the id to answer it with."""

    level: StopLevel
    why: str | None = None
    identity: RequestId = None


def stop_in(line: bytes) -> StopLine:
    """Read a line as a stop: a level's bare name, a JSON-RPC request `stop`, else a `hold`.

    Never raises, whatever the bytes are. A line that says something else is its own reason; a
    reason that cannot be shown is left out.
    """
    level = _LEVELS.get(line.strip().lower().decode(errors="replace"))
    if level is not None:
        return StopLine(level)
    request = parse(line)
    if isinstance(request, BadRequest) or request.method != "stop":
        return StopLine("hold", _shown(line.decode(errors="replace")), request.identity)
    wanted, why = request.params.get("level"), request.params.get("why")
    level = _LEVELS.get(wanted, "hold") if isinstance(wanted, str) else "hold"
    return StopLine(level, _shown(why) if isinstance(why, str) else None, request.identity)


def _shown(text: str) -> str | None:
    """Return a reason as one short line; None where there is nothing that can be shown."""
    text = text.strip()
    return text[:_WHY_CHARACTERS] if text.isprintable() and text else None
