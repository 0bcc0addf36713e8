"""`litegripctl stop` and `litegripctl state` in their plain spellings, without the whole program.

Starting the whole program takes most of a stop's time. So this reads few spellings, imports next
to nothing, and prints only what is as usual. In every other case, an error above all, the whole
program does it from the start: to stop or to ask twice does no harm.
"""

from __future__ import annotations

import os
from _json import make_scanner
from _socket import AF_UNIX, SOCK_STREAM, socket

from litegrip_client.core.sockets import (
    CHANNEL_VARIABLE,
    DEFAULT_CHANNEL,
    STOP_LEVELS,
    is_for_stops,
    is_reached,
    paths,
    stop_path,
)
from litegrip_client.ctl.state_view import state_text, stopped
from litegrip_client.values.figures import PROGRAM

TYPE_CHECKING = False
if TYPE_CHECKING:  # see core/sockets
    from typing import Any

    from litegrip_client.values.figures import Here

PROTOCOL = 1
_STOP_WITHIN_S = 0.5
_STATE_WITHIN_S = 0.5
"""The whole program then asks again, for longer, and says what is wrong."""
_MOST_BYTES = 65_536
_LONGEST_CHANNEL = 64
_NOT_AS_USUAL = (
    *(OSError, ValueError, KeyError, TypeError, AttributeError),
    *(StopIteration, RecursionError),  # of the scanner, for what is no JSON
)


class _Json:
    """How JSON is read: `json.loads` does the same, but 5 ms go by until it is imported."""

    strict = True
    object_hook = object_pairs_hook = None
    parse_float = float
    parse_int = int
    parse_constant = float


def answer(given: list[str]) -> str | None:
    """Carry out a plain stop or state; return what to print, None where that was not possible."""
    plain = _read(given)
    if plain is None:
        return None
    command, level, channel = plain
    chosen = channel or os.environ.get(CHANNEL_VARIABLE)
    if not _is_plain(chosen or DEFAULT_CHANNEL):
        return None
    places = paths(chosen or DEFAULT_CHANNEL, None, os.environ)

    def here(text: str) -> str:
        return text if channel is None else text.replace(PROGRAM, f"{PROGRAM} -c {channel}")

    try:
        return _stop(places, level, here) if command == "stop" else _state(places, chosen, here)
    except _NOT_AS_USUAL:
        return None


def _read(given: list[str]) -> tuple[str, str, str | None] | None:
    """Return command, level and channel of `[-c CHANNEL] stop [--level LEVEL]` and the like."""
    rest = list(given)
    channel, level = None, "hold"
    commands: list[str] = []
    while rest:
        word = rest.pop(0)
        if word in ("stop", "state") and not commands:
            commands.append(word)
        elif word in ("-c", "--channel") and rest and channel is None:
            channel = rest.pop(0)
            if not _is_plain(channel):
                return None
        elif word == "--level" and rest and commands == ["stop"] and rest[0] in STOP_LEVELS:
            level = rest.pop(0)
        else:
            return None
    return (commands[0], level, channel) if commands else None


def _is_plain(channel: str) -> bool:
    """Return True for a channel of this machine that needs no quotes in a shell."""
    letters = channel.replace("_", "").replace("-", "")
    return (
        letters.isascii()
        and letters.isalnum()
        and len(channel) <= _LONGEST_CHANNEL
        and not channel.startswith("-")
    )


def _stop(places: list[str], level: str, here: Here) -> str | None:
    request = '{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"%s"}}\n' % level  # noqa: UP031
    for path in places:
        try:
            (latched,) = _ask(stop_path(path), request, 1, _STOP_WITHIN_S)
        except FileNotFoundError:
            continue
        if latched["level"] not in STOP_LEVELS or not is_reached(latched):
            return None
        return stopped(latched, here)
    return None


def _state(places: list[str], chosen: str | None, here: Here) -> str | None:
    requests = (
        '{"jsonrpc":"2.0","id":1,"method":"hello","params":{"client":"litegripctl"}}\n'
        '{"jsonrpc":"2.0","id":2,"method":"state.get"}\n'
    )
    if any(map(is_for_stops, places)):
        return None
    for path in places:
        try:
            hello, state = _ask(path, requests, 2, _STATE_WITHIN_S)
        except FileNotFoundError:
            continue
        if hello["protocol"] != PROTOCOL or chosen not in (None, hello["channel"]):
            return None
        return state_text(state, here)
    return None


def _ask(path: str, requests: str, count: int, limit_s: float) -> list[dict[str, Any]]:
    """Return the results of `count` requests with the numbers from 1 on; raises what goes wrong."""
    connected = socket(AF_UNIX, SOCK_STREAM)
    try:
        connected.settimeout(limit_s)
        connected.connect(path)
        connected.sendall(requests.encode())
        received = b""
        while received.count(b"\n") < count:
            piece = connected.recv(_MOST_BYTES)
            if not piece or len(received) > _MOST_BYTES:
                raise ValueError("no answer")
            received += piece
    finally:
        connected.close()
    return [_result(line, 1 + at) for at, line in enumerate(received.decode().split("\n")[:-1])]


def _result(line: str, number: int) -> dict[str, Any]:
    message, end = make_scanner(_Json)(line, 0)  # type: ignore[arg-type]
    if end != len(line) or message["id"] != number or not isinstance(message["result"], dict):
        raise ValueError(line)
    result: dict[str, Any] = message["result"]
    return result
