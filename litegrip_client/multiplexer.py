"""Many waiting threads on one stream, without a thread of its own.

Of the threads that wait, one reads for all (the leader); the others (followers) sleep and are
woken when something came for them, or when the leader leaves. What came, and for whom, is the
router's to know.

An interrupt (KeyboardInterrupt) can come between any two instructions. So a line is forgotten
only after it was routed, routing it twice does no harm, and nobody sleeps longer than a slice
without looking around for itself.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque

from litegrip_client.errors import CommandError, ConnectError
from litegrip_client.router import Router, no_answer
from litegrip_client.stream import SLICE_S, LineStream, StreamEndedError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


class Multiplexer:
    """Hands what comes on a stream to a router, and lets threads wait for their inboxes."""

    def __init__(self, path: str, timeout_s: float, router: Router) -> None:
        """Connect to `path`; raises `OSError`."""
        self._stream = LineStream(path, timeout_s)
        self._router = router
        self._pid = os.getpid()
        # Re-entrant, because a signal handler may make a call, too.
        self._lock = threading.RLock()
        self._woken = threading.Condition(self._lock)
        self._leader: int | None = None
        self._followers = 0

    @property
    def is_own(self) -> bool:
        """True if this process made the connection, not the parent process before a fork."""
        return os.getpid() == self._pid

    @property
    def daemon_pid(self) -> int:
        """The process id of the other end, 0 if unknown."""
        return self._stream.peer_pid

    @property
    def closed(self) -> bool:
        """True if the connection has ended: every further call fails."""
        return self._router.ending is not None or not self.is_own or self._stream.hung_up

    @property
    def is_waiting_here(self) -> bool:
        """True in a signal handler that interrupts a call of its own thread."""
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
        self._router.check()

    def send(self, line: bytes, timeout_s: float) -> None:
        """Send one line. That the daemon is gone shows in `wait`, with what it said before."""
        try:
            self._stream.send(line, timeout_s)
        except TimeoutError as error:
            raise no_answer("the daemon does not read its requests", timeout_s) from error
        except OSError as error:
            if not self._stream.hung_up:
                self._end(f"the connection cannot be used any more: {error}", "connection_lost")

    def wait(self, inbox: deque[Any], timeout_s: float, what: str) -> None:
        """Return when `inbox` holds something; raises `ConnectError` when that cannot come."""
        me = threading.get_ident()
        deadline_s = time.monotonic() + timeout_s
        try:
            while not inbox:
                self._router.check()
                if (remaining_s := deadline_s - time.monotonic()) <= 0.0:
                    raise no_answer(f"the daemon did not answer {what}", timeout_s)
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
            if self._router.ending is None and self._may_lead(me):
                self._read(0.0)
        finally:
            if self._leader == me:
                self._leader = None
                self._wake_followers()
        self._router.check()

    def _may_lead(self, me: int) -> bool:
        with self._lock:
            if self._leader is None:
                self._leader = me
            return self._leader == me

    def _lead(self, inbox: deque[Any], deadline_s: float) -> None:
        while not inbox and self._router.ending is None:
            if (remaining_s := deadline_s - time.monotonic()) <= 0.0:
                return
            self._read(min(remaining_s, SLICE_S))
            self._wake_followers()

    def _follow(self, inbox: deque[Any], wait_s: float) -> None:
        with self._lock:
            self._followers += 1
            try:
                if not inbox and self._leader is not None and self._router.ending is None:
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
        except StreamEndedError:
            self._end("the daemon ended the connection", "connection_lost")
            return
        complaint = self._router.take(lines)
        if complaint is None:
            self._stream.keep(rest)
        else:
            self._end(complaint, "connection_lost")

    def close(self) -> None:
        """End the connection; in a forked child only the child's copy of it."""
        if self.is_own:
            self._end("this connection was closed", "closed")
        self._stream.close(shared=not self.is_own)

    def _end(self, message: str, reason: str) -> None:
        with self._lock:
            self._router.end(message, reason)
            self._woken.notify_all()
