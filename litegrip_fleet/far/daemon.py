"""A daemon of this machine, as the gateway asks and stops it."""

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from typing import Any

from litegrip_client.core.discovery import reach
from litegrip_client.core.sockets import stop_path
from litegrip_client.line.exchange import request_line
from litegrip_client.values.errors import LiteGripError, from_error_object
from litegrip_fleet.wire.answers import UNREACHABLE, error_object
from litegrip_fleet.wire.daemon_lines import MAX_ANSWER_BYTES

ANSWER_WITHIN_S = 2.0
STOP_WITHIN_S = 1.0
_READ_BYTES = 65_536


async def connected(channel: str) -> tuple[str, asyncio.StreamReader, asyncio.StreamWriter]:
    """Connect to a daemon; return its socket's path, too. Raises `ConnectError` without one."""

    async def attempt(path: str) -> tuple[str, asyncio.StreamReader, asyncio.StreamWriter]:
        return (path, *await asyncio.open_unix_connection(path, limit=MAX_ANSWER_BYTES))

    return await reach(channel, None, attempt)


async def asked_of(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    method: str,
    params: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Ask the daemon, and wait for the answer; raises `LiteGripError` for a refusal."""
    writer.write(request_line(0, method, params))
    while True:
        try:
            line = await asyncio.wait_for(reader.readline(), ANSWER_WITHIN_S)
        except (asyncio.TimeoutError, OSError) as error:
            text = f"the daemon does not answer {method}: {error}"
            raise unreachable(text) from error
        if not line:
            text = f"the daemon has closed the connection before it answered {method}"
            raise unreachable(text)
        answer = json.loads(line)
        if "error" in answer:
            raise from_error_object(answer["error"], method)
        if answer.get("id") == 0:
            result: dict[str, Any] = answer["result"]
            return result


async def lines_of(reader: asyncio.StreamReader) -> AsyncIterator[bytes]:
    """Yield a daemon's lines until it closes; raises `ValueError` for one beyond all bounds.

    By what has come, and not by `readline`, which costs twice as much for each.
    """
    begun: list[bytes] = []
    size_bytes = 0
    while received := await reader.read(_READ_BYTES):
        *lines, rest = received.split(b"\n")
        for line in lines:
            yield b"".join((*begun, line, b"\n"))
            begun.clear()
        size_bytes = len(rest) + (0 if lines else size_bytes)
        if size_bytes > MAX_ANSWER_BYTES:
            raise ValueError(f"a line of more than {MAX_ANSWER_BYTES} bytes")
        if rest:
            begun.append(rest)
    if begun:
        yield b"".join(begun)


def how_it_is(
    hello: Mapping[str, Any],
    health: Mapping[str, Any],
    state: Mapping[str, Any],
    lease: Mapping[str, Any],
) -> dict[str, Any]:
    """Return what a list of grippers says of one; raises `KeyError` for strange answers."""
    owner = lease["owner"]
    return {
        "version": hello["version"],
        "verdict": health["verdict"],
        "mode": state["mode"],
        "age_s": state["age_s"],
        "owner": None if owner is None else owner["program"],
    }


async def stop(channel: str, level: str, why: str) -> None:
    """Stop by the daemon's stop socket; raises `LiteGripError` if it does not confirm it."""

    async def attempt(path: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_unix_connection(stop_path(path))

    reader, writer = await reach(channel, None, attempt)
    try:
        writer.write(request_line(1, "stop", {"level": level, "why": why}))
        answer = json.loads(await asyncio.wait_for(reader.readline(), STOP_WITHIN_S))
        if "result" not in answer:
            raise from_error_object(answer["error"], "stop")
    except (asyncio.TimeoutError, OSError, ValueError, KeyError, TypeError) as error:
        text = f"the stop is not confirmed by the daemon of {channel}: {error!r}"
        raise unreachable(text) from error
    finally:
        writer.close()


def unreachable(text: str) -> LiteGripError:
    """Return the error that says that a daemon cannot be reached."""
    return from_error_object(error_object(UNREACHABLE, text))
