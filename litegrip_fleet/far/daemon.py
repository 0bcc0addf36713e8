"""A daemon of this machine, as the gateway asks and stops it."""

import asyncio
import json
import socket
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, cast

from litegrip_client.core.discovery import reach
from litegrip_client.core.sockets import stop_path
from litegrip_client.line.exchange import request_line
from litegrip_client.values.errors import LiteGripError, from_error_object
from litegrip_fleet.wire.answers import UNREACHABLE, error_object
from litegrip_fleet.wire.daemon_lines import MAX_ANSWER_BYTES

ANSWER_WITHIN_S = 2.0
STOP_WITHIN_S = 1.0
_READ_BYTES = 65_536


class Lines(asyncio.Protocol):
    """A connection whose lines are given to `follow` as they come: no task is woken for each."""

    transport: asyncio.Transport

    def __init__(self) -> None:
        self._take: Callable[[bytes], None] | None = None
        self._early: deque[bytes] = deque()
        self._has_come = asyncio.Event()
        self._has_ended = asyncio.Event()
        self._error: Exception | None = None
        self._begun: list[bytes] = []
        self._size_bytes = 0

    def write(self, data: bytes) -> None:
        """Send something."""
        self.transport.write(data)

    async def readline(self) -> bytes:
        """Return the next line, before they are followed; empty at the end."""
        while not self._early and not self._has_ended.is_set():
            self._has_come.clear()
            await self._has_come.wait()
        return self._early.popleft() if self._early else b""

    async def follow(self, take: Callable[[bytes], None]) -> None:
        """Have each line taken until the end; raises what has ended them.

        `OSError` for a connection that has broken, `ValueError` for a line beyond all bounds.
        """
        self._take = take
        while self._early:
            take(self._early.popleft())
        await self._has_ended.wait()
        if self._error is not None:
            raise self._error

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        self.transport = cast("asyncio.Transport", transport)

    def data_received(self, data: bytes) -> None:
        """Take what has come."""
        *lines, rest = data.split(b"\n")
        try:
            for line in lines:
                begun, self._begun = self._begun, []
                self._give(b"".join((*begun, line, b"\n")))
        except Exception as error:  # noqa: BLE001 - who follows them has to deal with it
            self._end(error)
        self._size_bytes = len(rest) + (0 if lines else self._size_bytes)
        if self._size_bytes > MAX_ANSWER_BYTES:
            self._end(ValueError(f"a line of more than {MAX_ANSWER_BYTES} bytes"))
        elif rest:
            self._begun.append(rest)

    def connection_lost(self, error: Exception | None) -> None:
        """Take the end, and what is no whole line."""
        if self._begun and not self._has_ended.is_set():
            self._give(b"".join(self._begun))
        self._end(error)

    def _give(self, line: bytes) -> None:
        if self._has_ended.is_set():
            return
        if self._take is not None:
            self._take(line)
        else:
            self._early.append(line)
            self._has_come.set()

    def _end(self, error: Exception | None) -> None:
        if not self._has_ended.is_set():
            self._error = error
            self._has_ended.set()
            self._has_come.set()
            self.transport.close()


async def followed(channel: str) -> tuple[str, Lines]:
    """Connect to a daemon, to follow its lines; as `connected`."""

    async def attempt(path: str) -> tuple[str, Lines]:
        return (path, (await asyncio.get_running_loop().create_unix_connection(Lines, path))[1])

    return await reach(channel, None, attempt)


async def connected(channel: str) -> tuple[str, asyncio.StreamReader, asyncio.StreamWriter]:
    """Connect to a daemon; return its socket's path, too. Raises `ConnectError` without one."""

    async def attempt(path: str) -> tuple[str, asyncio.StreamReader, asyncio.StreamWriter]:
        return (path, *await asyncio.open_unix_connection(path, limit=MAX_ANSWER_BYTES))

    return await reach(channel, None, attempt)


async def asked_of(
    reader: asyncio.StreamReader | Lines,
    writer: asyncio.StreamWriter | Lines,
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


async def told_to_stop(path: str, line: bytes) -> bytes:
    """Give a daemon's socket for stops a line; return the answer. Raises `OSError`."""
    loop, answer = asyncio.get_running_loop(), b""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connected:
        connected.setblocking(False)
        await loop.sock_connect(connected, path)
        await loop.sock_sendall(connected, line)
        while b"\n" not in answer:
            received = await loop.sock_recv(connected, _READ_BYTES)
            if not received:
                break
            answer += received
    return answer


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
