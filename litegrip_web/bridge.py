"""One browser at one gripper: what it sends goes to the daemon, what that says comes back.

A message is a line of the daemon's protocol; there is no second one. Of its own the bridge says
two things, as notifications: `web.welcome`, when a connection to the daemon begins, and
`web.no_daemon`, when there is none.
"""

from __future__ import annotations

import asyncio
import hmac
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from litegrip_client.core.discovery import reach
from litegrip_client.core.stop import is_taken_as_meant, stop_at
from litegrip_client.values.errors import ConnectError, LiteGripError
from litegrip_web.allowed import ACT, READ

WRONG_TOKEN, TOO_LATE, TOO_MANY = 4401, 4408, 4429
"""Codes with which a browser's connection is closed; 4000 and more are an application's own."""

TOKEN_WITHIN_S = 5.0
STOP_WITHIN_S = 1.0
RECONNECT_EVERY_S = 0.5
MOST_BROWSERS = 8
"""For each gripper."""

_LONGEST_ANSWER_BYTES = 16 * 1024 * 1024
_NOT_PERMITTED, _INVALID_REQUEST, _PARSE_ERROR, _INVALID_PARAMS = -32028, -32600, -32700, -32602
_NO_DAEMON = -32099


@dataclass(frozen=True, slots=True)
class Gripper:
    """A gripper that the page shows: its channel, and the daemon's socket where that was given."""

    channel: str
    socket: str | None = None


class RefusedError(Exception):
    """A browser's message that goes no further: the error that answers it."""

    def __init__(self, code: int, reason: str, message: str, identity: object = None) -> None:
        super().__init__(message)
        self.error = {
            "jsonrpc": "2.0",
            "id": identity,
            "error": {
                "code": code,
                "message": message,
                "data": {"reason": reason, "retryable": False},
            },
        }


class _Link:
    """The connection to a daemon, while there is one."""

    def __init__(self) -> None:
        self.writer: asyncio.StreamWriter | None = None

    async def send(self, request: Mapping[str, Any]) -> None:
        """Send a request; raises `RefusedError` without a daemon."""
        if self.writer is None:
            raise RefusedError(_NO_DAEMON, "no_daemon", "no daemon answers", request.get("id"))
        self.writer.write(json.dumps(request).encode() + b"\n")
        await self.writer.drain()


class Bridge:
    """Joins browsers to the daemon of one gripper; `operate` allows them to act."""

    def __init__(self, gripper: Gripper, token: str, *, operate: bool) -> None:
        self._gripper = gripper
        self._token = token
        self._operate = operate
        self._allowed = READ | ACT if operate else READ
        self._browsers = 0

    async def serve(self, browser: ServerConnection) -> None:
        """Serve a browser until it or the daemon goes."""
        if not await self._is_known(browser):
            return
        if self._browsers >= MOST_BROWSERS:
            await browser.close(TOO_MANY, f"{MOST_BROWSERS} browsers at most for a gripper")
            return
        self._browsers += 1
        try:
            await self._join(browser)
        except ConnectionClosed:
            return  # a page that is closed has nothing more to be told
        finally:
            self._browsers -= 1

    async def _is_known(self, browser: ServerConnection) -> bool:
        """Return True if the browser's first message is the token, in time; else close it."""
        try:
            first = await asyncio.wait_for(browser.recv(), TOKEN_WITHIN_S)
        except asyncio.TimeoutError:
            await browser.close(TOO_LATE, "no token came")
            return False
        except ConnectionClosed:
            return False
        if not hmac.compare_digest(_token_of(first).encode(), self._token.encode()):
            await browser.close(WRONG_TOKEN, "the token is wrong")
            return False
        return True

    async def _join(self, browser: ServerConnection) -> None:
        link = _Link()
        daemon = asyncio.create_task(self._keep_daemon(browser, link))
        reading = asyncio.create_task(self._from_browser(browser, link))
        await asyncio.wait((daemon, reading), return_when=asyncio.FIRST_COMPLETED)
        for task in (daemon, reading):
            task.cancel()
        for ended in await asyncio.gather(daemon, reading, return_exceptions=True):
            if isinstance(ended, Exception):
                raise ended

    async def _keep_daemon(self, browser: ServerConnection, link: _Link) -> None:
        """Connect to the daemon, again whenever it has gone, and pass its lines on."""

        async def attempt(path: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            return await asyncio.open_unix_connection(path, limit=_LONGEST_ANSWER_BYTES)

        told, gripper = "", self._gripper
        while True:
            try:
                daemon, writer = await reach(gripper.channel, gripper.socket, attempt)
            except ConnectError as error:
                why = error.message
            else:
                link.writer = writer
                welcome = {"channel": gripper.channel, "operate": self._operate}
                try:
                    await _tell(browser, "web.welcome", welcome)
                    why = await _from_daemon(browser, daemon)
                finally:
                    writer.close()
                    link.writer = None
                told = ""
            if why != told:
                told = why
                await _tell(browser, "web.no_daemon", {"message": why})
            await asyncio.sleep(RECONNECT_EVERY_S)

    async def _from_browser(self, browser: ServerConnection, link: _Link) -> None:
        """Pass a browser's requests on until it goes."""
        stops: set[asyncio.Task[None]] = set()
        try:
            async for text in browser:
                try:
                    request = self._check(text)
                    if request["method"] == "stop":
                        # Beside what waits before it.
                        task = asyncio.create_task(self._stop(browser, request, link))
                        stops.add(task)
                        task.add_done_callback(stops.discard)
                    else:
                        await link.send(request)
                except RefusedError as refused:
                    await browser.send(json.dumps(refused.error))
        finally:
            # A stop that was asked for is given, also by a page that is closed at once.
            await asyncio.shield(asyncio.gather(*stops, return_exceptions=True))

    def _check(self, text: str | bytes) -> dict[str, Any]:
        """Return a browser's request; raises `RefusedError` for one that goes no further."""
        request = _parse(text)
        identity, method = request.get("id"), request.get("method")
        if not isinstance(method, str):
            raise RefusedError(_INVALID_REQUEST, "invalid_request", "it names no method", identity)
        if method == "stop" or method in self._allowed:
            return request
        if method in ACT:
            text = f"{method}: this page only shows; litegripd-web --operate lets it act"
            raise RefusedError(_NOT_PERMITTED, "not_permitted", text, identity)
        raise RefusedError(
            _NOT_PERMITTED, "not_permitted", f"{method!r}: not from a page", identity
        )

    async def _stop(
        self, browser: ServerConnection, request: Mapping[str, Any], link: _Link
    ) -> None:
        """Stop by the daemon's socket for stops; by the connection where that does not work."""
        params = request.get("params") or {}
        try:
            result = await self._stop_now(params) if is_taken_as_meant(params) else None
        except LiteGripError:
            result = None
        if result is None:
            try:
                await link.send(request)
            except RefusedError as refused:
                await browser.send(json.dumps(refused.error))
            return
        answer = {"jsonrpc": "2.0", "id": request.get("id"), "result": result}
        await browser.send(json.dumps(answer))

    async def _stop_now(self, params: Mapping[str, Any]) -> dict[str, Any]:
        async def attempt(path: str) -> dict[str, Any]:
            level, why = params["level"], params.get("why")
            return await asyncio.to_thread(stop_at, path, level, why, STOP_WITHIN_S)

        return await reach(self._gripper.channel, self._gripper.socket, attempt)


def _token_of(first: str | bytes) -> str:
    """Return the token in a browser's first message, or what is no token."""
    try:
        token = _parse(first).get("token")
    except RefusedError:
        return ""
    return token if isinstance(token, str) else ""


def _parse(text: str | bytes) -> dict[str, Any]:
    """Return a message as an object; raises `RefusedError`.

    A name that comes twice is refused here, so that the daemon reads what was checked.
    """
    if isinstance(text, bytes):
        raise RefusedError(_INVALID_REQUEST, "invalid_request", "a message must be text")
    try:
        request = json.loads(text, object_pairs_hook=_without_duplicates)
    except (ValueError, RecursionError) as error:
        raise RefusedError(_PARSE_ERROR, "parse_error", f"not JSON: {error}") from error
    if not isinstance(request, dict):
        raise RefusedError(_INVALID_REQUEST, "invalid_request", "a message must be one object")
    params = request.get("params")
    if params is not None and not isinstance(params, dict):
        raise RefusedError(
            _INVALID_PARAMS,
            "invalid_params",
            "params must be an object",
            request.get("id"),
        )
    return request


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name comes twice")
    return found


async def _tell(browser: ServerConnection, method: str, params: Mapping[str, Any]) -> None:
    await browser.send(json.dumps({"jsonrpc": "2.0", "method": method, "params": params}))


async def _from_daemon(browser: ServerConnection, daemon: asyncio.StreamReader) -> str:
    """Pass the daemon's lines on, as fast as the browser takes them; return why they end."""
    try:
        while line := await daemon.readline():
            await browser.send(line.decode())
    except OSError as error:
        return error.strerror or str(error)
    return "the daemon has closed the connection"
