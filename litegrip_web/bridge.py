"""One browser at one gripper: what it sends goes to the daemon, what that says comes back.

A message is a line of the daemon's protocol; there is no second one. Of its own the bridge says
two things, as notifications: `web.welcome`, when a connection to the daemon begins, and
`web.no_daemon`, when there is none. Of a browser's, it keeps `web.seen`: a state has been shown;
and `web.clock`, which asks for its clock. By that a page says with each request when it was sent.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import pwd
import time
from collections.abc import Mapping
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from litegrip_client.core.stop import is_taken_as_meant
from litegrip_client.values.errors import ConnectError, LiteGripError
from litegrip_web.allowed import ACT, MOVE, READ
from litegrip_web.gripper import Gripper
from litegrip_web.history import History
from litegrip_web.outbox import Outbox
from litegrip_web.proof import NONCE, is_proof, new_nonce, proof
from litegrip_web.stops import Stops

WRONG_TOKEN, TOO_LATE, TOO_MANY = 4401, 4408, 4429
"""Codes with which a browser's connection is closed; 4000 and more are an application's own."""

TOKEN_WITHIN_S = 5.0
RECONNECT_EVERY_S = 0.5
MAX_MESSAGE_BYTES = 16_384
"""As of the daemon's lines."""

MESSAGES_AT_ONCE, AT_ONCE_S = 100, 0.25
"""So many messages of one browser are read in so many seconds: it is not alone."""

MOST_BROWSERS = 8
"""For each gripper."""

LATE_S = 1.0
"""What moves the jaws is too late then: the page says so of what it shows, and nobody would see the
motion that was asked for."""

_LONGEST_ANSWER_BYTES = 16 * 1024 * 1024
_NOT_PERMITTED, _INVALID_REQUEST, _PARSE_ERROR, _INVALID_PARAMS = -32028, -32600, -32700, -32602
_NO_DAEMON, _LATE = -32099, -32098
_STATE = b'{"jsonrpc":"2.0","method":"state.sample",'
"""How the daemon begins a notification; a state that began otherwise would only not be passed
over."""


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

    _MOST_UNREAD_BYTES = 65_536

    def __init__(self) -> None:
        self.writer: asyncio.StreamWriter | None = None

    def send(self, request: Mapping[str, Any]) -> None:
        """Send a request; raises `RefusedError` if that cannot be now. Never waits."""
        identity = request.get("id")
        if self.writer is None:
            raise RefusedError(_NO_DAEMON, "no_daemon", "no daemon answers", identity)
        text = json.dumps(request, ensure_ascii=False, separators=(",", ":"))
        try:
            line = text.encode() + b"\n"
        except UnicodeEncodeError:
            raise RefusedError(
                _INVALID_REQUEST, "invalid_request", "half of a surrogate pair is no text"
            ) from None
        if len(line) > MAX_MESSAGE_BYTES:
            text = f"as one line it has more than {MAX_MESSAGE_BYTES} bytes"
            raise RefusedError(_INVALID_REQUEST, "invalid_request", text, identity)
        if self.writer.transport.get_write_buffer_size() > self._MOST_UNREAD_BYTES:
            text = "the daemon does not read what it is asked"
            raise RefusedError(_NO_DAEMON, "no_daemon", text, identity)
        self.writer.write(line)


class Bridge:
    """Joins browsers to the daemon of one gripper; `operate` allows them to act."""

    def __init__(self, gripper: Gripper, token: str, *, operate: bool) -> None:
        self._gripper = gripper
        self._token = token
        self._operate = operate
        self._allowed = READ | ACT if operate else READ
        self._browsers = 0
        self._stops = Stops(gripper)
        self.history = History(gripper)

    async def serve(self, browser: ServerConnection) -> None:
        """Serve a browser that is known until it or the daemon goes."""
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

    async def is_known(self, browser: ServerConnection, host: str) -> bool:
        """Return True if the browser proves in time that it knows the secret; else close it.

        `host` is that of the page's address.
        """
        try:
            knows = await asyncio.wait_for(self._prove(browser, host), TOKEN_WITHIN_S)
        except asyncio.TimeoutError:
            await browser.close(TOO_LATE, "no proof came")
            return False
        except ConnectionClosed:
            return False
        if not knows:
            await browser.close(WRONG_TOKEN, "the secret is wrong")
        return knows

    async def _prove(self, browser: ServerConnection, host: str) -> bool:
        """Prove the secret to the page, and return True if the page proves it then."""
        page_nonce = _member(await browser.recv(), "nonce")
        if not isinstance(page_nonce, str) or NONCE.fullmatch(page_nonce) is None:
            return False
        own_nonce = new_nonce()
        proofs = [
            proof(self._token, role, host, page_nonce, own_nonce) for role in ("server", "page")
        ]
        await browser.send(json.dumps({"nonce": own_nonce, "proof": proofs[0]}))
        return is_proof(_member(await browser.recv(), "proof"), proofs[1])

    async def _join(self, browser: ServerConnection) -> None:
        link, outbox = _Link(), Outbox()
        tasks = [
            asyncio.create_task(self._keep_daemon(outbox, link)),
            asyncio.create_task(self._from_browser(browser, outbox, link)),
            asyncio.create_task(_send_all(outbox, browser)),
        ]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(ended, Exception):
                raise ended

    async def _keep_daemon(self, outbox: Outbox, link: _Link) -> None:
        """Connect to the daemon, again whenever it has gone, and pass its lines on."""
        told, gripper = "", self._gripper
        while True:
            try:
                daemon, writer = await gripper.connect(_LONGEST_ANSWER_BYTES)
            except ConnectError as error:
                why = error.message
            else:
                link.writer, began_s = writer, time.monotonic()
                welcome = {
                    "channel": gripper.channel,
                    "operate": self._operate,
                    "user": _own_user(),
                    "history": self.history.as_params(),
                }
                outbox.forget_states()
                outbox.put_now(_notification("web.welcome", welcome))
                try:
                    why = await _from_daemon(outbox, daemon)
                finally:
                    writer.close()
                    link.writer = None
                outbox.forget_states()
                told = ""
                if time.monotonic() - began_s > RECONNECT_EVERY_S:
                    continue  # a successor may serve already: only who finds none says so
            if why != told:
                told = why
                outbox.put_now(_notification("web.no_daemon", {"message": why}))
            await asyncio.sleep(RECONNECT_EVERY_S)

    async def _from_browser(self, browser: ServerConnection, outbox: Outbox, link: _Link) -> None:
        """Pass a browser's requests on until it goes."""
        stops: set[asyncio.Task[None]] = set()
        began_s, taken = time.monotonic(), 0
        try:
            async for text in browser:
                taken += 1
                if taken >= MESSAGES_AT_ONCE:
                    await asyncio.sleep(max(0.0, began_s + AT_ONCE_S - time.monotonic()))
                    began_s, taken = time.monotonic(), 0
                try:
                    request = self._check(text)
                    if request["method"] == "web.seen":
                        outbox.see()
                    elif request["method"] == "web.clock":
                        clock = {"monotonic_s": time.monotonic()}
                        outbox.put_now(_answer(request.get("id"), clock))
                    elif request["method"] == "stop":
                        # Beside what waits before it.
                        task = asyncio.create_task(self._stop(outbox, request, link))
                        stops.add(task)
                        task.add_done_callback(stops.discard)
                    else:
                        link.send(request)
                except RefusedError as refused:
                    outbox.put_now(json.dumps(refused.error))
        finally:
            # A stop that was asked for is given, also by a page that is closed at once.
            await asyncio.shield(asyncio.gather(*stops, return_exceptions=True))

    def _check(self, text: str | bytes) -> dict[str, Any]:
        """Return a browser's request; raises `RefusedError` for one that goes no further."""
        request = _parse(text)
        identity, method = request.get("id"), request.get("method")
        if not isinstance(method, str):
            raise RefusedError(_INVALID_REQUEST, "invalid_request", "it names no method", identity)
        sent_s = request.pop("sent_s", None)
        if method in ("stop", "web.seen", "web.clock") or method in self._allowed:
            if method in MOVE and sent_s is not None:
                _check_in_time(sent_s, identity)
            return request
        if method in ACT:
            text = f"{method}: this page only shows; litegripd-web --operate lets it act"
            raise RefusedError(_NOT_PERMITTED, "not_permitted", text, identity)
        raise RefusedError(
            _NOT_PERMITTED, "not_permitted", f"{method!r}: not from a page", identity
        )

    async def _stop(self, outbox: Outbox, request: Mapping[str, Any], link: _Link) -> None:
        """Stop by the daemon's socket for stops; by the connection where that does not work."""
        params = request.get("params") or {}
        with contextlib.suppress(LiteGripError):
            if is_taken_as_meant(params):
                result = await self._stops.stop(params["level"], params.get("why"))
                outbox.put_now(_answer(request.get("id"), result))
                return
        try:
            link.send({**request, "params": params})
        except RefusedError as refused:
            outbox.put_now(json.dumps(refused.error))


def _check_in_time(sent_s: object, identity: object) -> None:
    if isinstance(sent_s, bool) or not isinstance(sent_s, int | float):
        text = "sent_s is no number: seconds of the clock that web.clock tells"
        raise RefusedError(_INVALID_REQUEST, "invalid_request", text, identity)
    late_s = time.monotonic() - sent_s
    if late_s > LATE_S:
        text = f"it came {late_s:.1f} s after it was pressed, so it was not done: press it again"
        raise RefusedError(_LATE, "late", text, identity)


def _own_user() -> str:
    """Return the name of the user that this runs as, whose rights the daemon knows."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return str(os.getuid())


def _member(message: str | bytes, name: str) -> object:
    """Return a member of a browser's message; None if there is none, or no message."""
    try:
        return _parse(message).get(name)
    except RefusedError:
        return None


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
    if not (params is None or params == [] or isinstance(params, dict)):
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


def _answer(identity: object, result: Mapping[str, Any]) -> str:
    return json.dumps({"jsonrpc": "2.0", "id": identity, "result": result})


def _notification(method: str, params: Mapping[str, Any]) -> str:
    return json.dumps({"jsonrpc": "2.0", "method": method, "params": params})


async def _from_daemon(outbox: Outbox, daemon: asyncio.StreamReader) -> str:
    """Pass the daemon's lines on; return why they end."""
    try:
        while line := await daemon.readline():
            if line.startswith(_STATE):
                outbox.put_state(line.decode())
            else:
                await outbox.put(line.decode())
    except (OSError, ValueError) as error:  # the latter: a line without end
        why = getattr(error, "strerror", None) or str(error)
        return f"the connection to the daemon is lost: {why}"
    return "the daemon has closed the connection"


async def _send_all(outbox: Outbox, browser: ServerConnection) -> None:
    while True:
        await browser.send(await outbox.take())
