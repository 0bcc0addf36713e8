"""Many waiting threads on one stream, without a thread of its own.

Of the threads that wait, one reads for all (the leader); the others (followers) sleep and are
woken when something came for them, or when the leader leaves. This module routes messages to
inboxes; it must not know what the methods mean.

An interrupt (KeyboardInterrupt) can come between any two instructions. So a line is forgotten
only after it was routed, routing it twice does no harm, and nobody sleeps longer than a slice
without looking around for itself.
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections import deque

from litegrip_client.calls import Call, Message
from litegrip_client.errors import CommandError, ConnectError, LiteGripError, from_error_object
from litegrip_client.stream import SLICE_S, LineStream, StreamEndedError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any, NoReturn, Protocol

    class Listener(Protocol):
        """What takes the samples of a subscription."""

        def deliver(self, sample: Message) -> None:
            """Take one sample, perhaps one that came already."""


_raw_decode = json.JSONDecoder().raw_decode


class Multiplexer:
    """Routes what comes on a stream. `calls` and `listeners` are those that wait, by number.

    `refusal` is the newest that a request without an answer got, until somebody takes it.
    """

    def __init__(self, path: str, timeout_s: float) -> None:
        """Connect to `path`; raises `OSError`."""
        self._stream = LineStream(path, timeout_s)
        self._pid = os.getpid()
        self.calls: dict[int, Call] = {}
        self.listeners: dict[int, Listener] = {}
        self.refusal: Message | None = None
        # Re-entrant, because a signal handler may make a call, too.
        self._lock = threading.RLock()
        self._woken = threading.Condition(self._lock)
        self._leader: int | None = None
        self._followers = 0
        self._ending: LiteGripError | None = None
        self._parting_error: Any = None

    @property
    def is_own(self) -> bool:
        """Whether this process made the connection, and not the parent that it was forked from."""
        return os.getpid() == self._pid

    @property
    def closed(self) -> bool:
        """Whether no further call can succeed."""
        return self._ending is not None or not self.is_own or self._stream.hung_up

    @property
    def is_waiting_here(self) -> bool:
        """Whether this very thread reads already: so in a signal handler during a call."""
        return self._leader == threading.get_ident()

    def check_usable(self) -> None:
        """Raise when this thread must not wait here, or cannot any more."""
        if not self.is_own:
            raise ConnectError(
                f"this connection belongs to process {self._pid}; its forked child "
                f"{os.getpid()} cannot use it",
                reason="forked",
                data={"hint": "connect anew in the child"},
            )
        if self.is_waiting_here:
            raise CommandError(
                "this thread waits for an answer on this connection already, so its signal "
                "handler cannot use it",
                reason="reentrant",
                data={"hint": "use another connection in the handler, or raise an exception"},
            )
        if self._ending is not None:
            self._raise_ending(self._ending)

    def send(self, line: bytes, timeout_s: float) -> None:
        """Send one line. That the daemon is gone shows in `wait`, with what it said before."""
        try:
            self._stream.send(line, timeout_s)
        except TimeoutError as error:
            raise _no_answer("the daemon does not read its requests", timeout_s) from error
        except OSError as error:
            if not self._stream.hung_up:
                self._end(f"the connection cannot be used any more: {error}", "connection_lost")

    def wait(self, inbox: deque[Any], timeout_s: float, what: str) -> None:
        """Return when `inbox` holds something; raises `ConnectError` when that cannot come."""
        me = threading.get_ident()
        deadline_s = time.monotonic() + timeout_s
        try:
            while not inbox:
                if self._ending is not None:
                    self._raise_ending(self._ending)
                if (remaining_s := deadline_s - time.monotonic()) <= 0.0:
                    raise _no_answer(f"the daemon did not answer {what}", timeout_s)
                if self._may_lead(me):
                    self._lead(inbox, deadline_s)
                else:
                    self._follow(inbox, min(remaining_s, SLICE_S))
        finally:
            if self._leader == me:
                self._leader = None
                self._wake_followers()

    def poll(self) -> None:
        """Route what has come already; raises `ConnectError` when the connection has ended."""
        me = threading.get_ident()
        try:
            if self._ending is None and self._may_lead(me):
                self._read(0.0)
        finally:
            if self._leader == me:
                self._leader = None
                self._wake_followers()
        if self._ending is not None:
            self._raise_ending(self._ending)

    def _may_lead(self, me: int) -> bool:
        with self._lock:
            if self._leader is None:
                self._leader = me
            return self._leader == me

    def _lead(self, inbox: deque[Any], deadline_s: float) -> None:
        while not inbox and self._ending is None:
            if (remaining_s := deadline_s - time.monotonic()) <= 0.0:
                return
            self._read(min(remaining_s, SLICE_S))
            self._wake_followers()

    def _follow(self, inbox: deque[Any], wait_s: float) -> None:
        with self._lock:
            self._followers += 1
            try:
                if not inbox and self._leader is not None and self._ending is None:
                    self._woken.wait(wait_s)
            finally:
                self._followers -= 1

    def _wake_followers(self) -> None:
        if self._followers:
            with self._lock:
                self._woken.notify_all()

    def _read(self, wait_s: float) -> None:
        try:
            lines, rest = self._stream.receive(wait_s)
            for line in lines:
                self._route(_decode(line))
        except StreamEndedError:
            self._end("the daemon ended the connection", "connection_lost")
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            self._end(f"the daemon sent what is not the protocol: {error!r}", "connection_lost")
        else:
            self._stream.keep(rest)

    def _route(self, message: Message) -> None:
        if "method" in message:
            self._route_notification(message)
        elif (identity := message["id"]) is None:
            self._parting_error = message["error"]
        elif (call := self.calls.get(identity)) is not None and not call.answered:
            if call.on_result is not None and "result" in message:
                call.on_result(message["result"])
            call.inbox.append(message)
            call.answered = True

    def _route_notification(self, message: Message) -> None:
        params = message["params"]
        if message["method"] == "job.progress":
            call = self.calls.get(params.get("request"))
            if call is not None and not call.answered:
                call.job = params["job"]
                call.inbox.append(message)
        elif message["method"] == "state.sample":
            listener = self.listeners.get(params["subscription"])
            if listener is not None:
                listener.deliver(params)
        elif message["method"] == "stream.refused":
            self.refusal = params

    def close(self) -> None:
        """End the connection; in a forked child only the child's copy of it."""
        if self.is_own:
            self._end("this connection was closed", "closed")
        self._stream.close(shared=not self.is_own)

    def _end(self, message: str, reason: str) -> None:
        data: dict[str, Any] = {"retryable": True}
        code = None
        if self._parting_error is not None:
            parting = from_error_object(self._parting_error)
            message = f"{message}: {parting.message}"
            reason, code, data = parting.reason or reason, parting.code, parting.data
        with self._lock:
            if self._ending is None:
                self._ending = ConnectError(message, reason=reason, code=code, data=data)
            self._woken.notify_all()

    @staticmethod
    def _raise_ending(ending: LiteGripError) -> NoReturn:
        # A new object for each raise: a traceback belongs to one thread.
        raise ConnectError(ending.message, reason=ending.reason, code=ending.code, data=ending.data)


def _no_answer(message: str, timeout_s: float) -> ConnectError:
    hint = "see whether it runs: systemctl status 'litegripd@*'"
    return ConnectError(
        f"{message} within {timeout_s:g} s",
        reason="no_answer",
        data={"retryable": True, "hint": hint},
    )


def _decode(line: bytes) -> Message:
    text = line.decode()
    message, end = _raw_decode(text)
    if end != len(text) or not isinstance(message, dict):
        raise ValueError(f"not one object in a line: {text:.80}")
    return message
