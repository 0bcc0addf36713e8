"""Calls and subscriptions over one connection to the daemon, for any number of threads.

From below: lines over a Unix stream socket (`LineStream`), many waiting threads on one stream
(`Multiplexer`), requests and their answers (`Connection`). This module must not know what the
methods do.

Of the threads that wait, one reads for all (the leader); the others (followers) sleep and are
woken when something came for them, or when the leader leaves. An interrupt (KeyboardInterrupt) can
come between any two instructions. So what was read stays in the stream until the reader is done
with it (`keep`): a line is forgotten only after it was routed, routing it twice does no harm, and
nobody sleeps longer than a slice without looking around for itself.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from weakref import ref

from litegrip_client.line.exchange import (
    DEFAULT_TIMEOUT_S,
    Call,
    Exchange,
    Progress,
    Router,
    Watch,
    answer_in,
    no_answer,
    or_closed,
    request_line,
)
from litegrip_client.values.errors import CommandError, ConnectError, LiteGripError
from litegrip_client.values.tracebacks import is_of_handler

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from types import FrameType
    from typing import Any, TypeVar

    from litegrip_client.line.exchange import Listener, Message
    from litegrip_client.line.feeds import EventSubscription, Feed, StateSample, Subscription

    _Item = TypeVar("_Item")

SLICE_S = 0.5
"""The longest that one `receive` waits."""

_CREDENTIALS = struct.Struct("3i")
_READ_BYTES = (32_768,)
_BLOCKING = (0,)
_NOT_BLOCKING = (socket.MSG_DONTWAIT,)


class StreamEndedError(Exception):
    """The other side closed the connection."""


class LineStream:
    """A connected socket. Sending is for any thread; one thread at a time may receive."""

    __slots__ = ("_chunks", "_cut", "_send_lock", "_socket", "peer_pid")

    def __init__(self, path: str, timeout_s: float) -> None:
        """Connect to `path`; raises `OSError` when that fails or takes over `timeout_s`."""
        self._socket = _connected(path, timeout_s)
        self.peer_pid = peer_pid(self._socket)
        self._chunks: list[bytes] = []
        self._send_lock = threading.RLock()
        self._cut = False

    def send(self, line: bytes, timeout_s: float) -> None:
        """Send one line with its newline.

        Raises `OSError` when the connection is gone and `TimeoutError` when the daemon does not
        take the line in time.
        """
        with self._send_lock:
            if self._cut:
                raise OSError("an earlier line was cut off half-way: connect again")
            try:
                sent = self._socket.send(line, socket.MSG_DONTWAIT)
            except BlockingIOError:
                sent = 0
            if sent < len(line):
                self._send_rest(line[sent:], timeout_s, cut=sent > 0)

    def _send_rest(self, line: bytes, timeout_s: float, *, cut: bool) -> None:
        deadline_s = time.monotonic() + timeout_s
        self._cut = cut
        while line:
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0.0 or not self._ready(select.POLLOUT, remaining_s):
                raise TimeoutError("the daemon does not read")
            self._cut = True
            line = line[self._socket.send(line, socket.MSG_DONTWAIT) :]
        self._cut = False

    def receive(self, wait_s: float) -> tuple[list[bytes], bytes]:
        """Wait at most `wait_s` and `SLICE_S`; return the complete lines and the incomplete rest.

        The same lines come again unless `keep(rest)` is called when they are handled. Raises
        `StreamEndedError` at the end of the stream.
        """
        chunks = self._chunks
        if not chunks or not any(b"\n" in chunk for chunk in chunks):
            self._fill(wait_s)
        *lines, rest = b"".join(chunks).split(b"\n")
        return lines, rest

    def _fill(self, wait_s: float) -> None:
        flags = _BLOCKING  # the socket's own time limit is SLICE_S: one system call does it
        try:
            if wait_s < SLICE_S:
                if not self._ready(select.POLLIN, wait_s):
                    return
                flags = _NOT_BLOCKING
            # In one C call, so that no interrupt can come between reading and storing.
            self._chunks.extend(map(self._socket.recv, _READ_BYTES, flags))
        except BlockingIOError:
            return
        except (OSError, ValueError) as error:  # ValueError: closed by another thread
            if is_of_handler(error):
                raise
            raise StreamEndedError from error
        if not self._chunks[-1]:
            raise StreamEndedError

    def keep(self, rest: bytes) -> None:
        """Forget all that was received except `rest`."""
        self._chunks[:] = [rest] if rest else []

    @property
    def has_more(self) -> bool:
        """True if something can be received without waiting, the end of the stream included."""
        return self._ready(select.POLLIN, 0.0)

    @property
    def hung_up(self) -> bool:
        """True if the other side is gone, as far as the kernel knows."""
        poller = select.poll()
        poller.register(self._socket, select.POLLRDHUP)
        return bool(poller.poll(0))

    def _ready(self, event: int, wait_s: float) -> bool:
        # A new object each time: one object must not be used twice at once, and a signal handler
        # can run while this waits.
        poller = select.poll()
        poller.register(self._socket, event)
        return bool(poller.poll(None if math.isinf(wait_s) else math.ceil(wait_s * 1000.0)))

    def close(self, *, shared: bool = False) -> None:
        """Close the socket; `shared`: another process uses it, too, and must not notice."""
        if not shared:
            try:
                self._socket.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits for it
            except OSError:
                self._chunks.clear()  # was closed already, by the daemon or by us
        self._socket.close()


def peer_pid(connected: socket.socket) -> int:
    """Return the process that listens at the other end; 0 where the kernel hides it from here."""
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid: int = _CREDENTIALS.unpack(credentials)[0]
    return pid


def _connected(path: str, timeout_s: float) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # A non-blocking connect would fail at once when the daemon's queue is full for a moment.
        _set_limit(connection, socket.SO_SNDTIMEO, timeout_s)
        _set_limit(connection, socket.SO_RCVTIMEO, SLICE_S)
        connection.connect(path)
    except BaseException:
        connection.close()
        raise
    return connection


def _set_limit(connection: socket.socket, option: int, limit_s: float) -> None:
    seconds, fraction = divmod(limit_s, 1.0)
    value = struct.pack("ll", int(seconds), int(fraction * 1e6))
    connection.setsockopt(socket.SOL_SOCKET, option, value)


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
        """True in a signal handler that interrupts a call of its own thread.

        Two interrupts at once can end such a call before it says that it waits no more: so the
        thread's stack counts, too.
        """
        if self._leader != threading.get_ident():
            return False
        frame: FrameType | None = sys._getframe(1)  # noqa: SLF001 - inspect is slow to import
        while frame is not None:
            if frame.f_code in _WAITING and frame.f_locals.get("self") is self:
                return True
            frame = frame.f_back
        self._stop_leading(threading.get_ident())
        return False

    def check_open(self) -> None:
        """Raise when nothing more can come here."""
        if os.getpid() != self._pid:
            raise ConnectError(
                f"this connection belongs to process {self._pid}; its forked child "
                f"{os.getpid()} cannot use it",
                reason="forked",
                data={"hint": "connect again in the child"},
            )
        if self._router.ending is not None:
            self._router.check(is_asked_late=True)

    def check_usable(self) -> None:
        """Raise when this thread must not wait here, or cannot any more."""
        if self._leader is not None and self.is_own and self.is_waiting_here:
            raise CommandError(
                "this thread waits for an answer on this connection already, so its signal "
                "handler cannot use it",
                reason="reentrant",
                data={"hint": "use another connection in the handler, or raise an exception"},
            )
        self.check_open()

    def send(self, line: bytes, timeout_s: float) -> None:
        """Send one line. That the daemon is gone shows in `wait`, with what it said before."""
        try:
            self._stream.send(line, timeout_s)
        except OSError as error:
            self._not_sent(error, timeout_s)

    def _not_sent(self, error: OSError, timeout_s: float) -> None:
        if is_of_handler(error):
            raise error
        if isinstance(error, TimeoutError):
            raise no_answer(
                "the daemon does not read its requests", timeout_s, self._router.here
            ) from None
        if not self._stream.hung_up:
            self._end(f"the connection cannot be used any more: {error}", "connection_lost")

    def ask(self, call: Call, line: bytes, send_s: float, wait_s: float) -> Message | None:
        """Send a request; return its answer if that is all that comes, else None: `wait` for it.

        It nearly always is, so this way is a straight one, with few calls. The router must know
        the request: another thread may read its answer. Waits for `wait_s` and `SLICE_S` at most.
        """
        me = threading.get_ident()
        stream = self._stream
        try:
            stream.send(line, send_s)
            with self._lock:
                if self._leader is None:
                    self._leader = me
            if self._leader != me or call.answered or call.keep or call.on_result is not None:
                return None
            lines, rest = stream.receive(wait_s)
            if rest or len(lines) != 1:
                return None
            answer = answer_in(lines[0], call.identity)
            if answer is not None:
                call.answered = True
                router = self._router
                router.is_silent = router.is_danger_told = False
                stream.keep(rest)
            return answer
        except StreamEndedError:
            return None  # `wait` finds it, too
        except OSError as error:
            self._not_sent(error, send_s)
            return None
        finally:
            if self._leader == me:
                self._leader = None
                if self._followers:
                    self._wake_followers()

    def wait(
        self,
        inbox: deque[Any],
        timeout_s: float,
        what: Callable[[], str],
        since_s: float,
        watch: Watch | None = None,
    ) -> None:
        """Return when `inbox` holds something; raises `ConnectError` when that cannot come.

        That is, by `timeout_s` after `since_s`, or when `watch` says so.
        """
        me = threading.get_ident()
        try:
            while not inbox:
                self._router.check()
                if (remaining_s := since_s + timeout_s - time.monotonic()) <= 0.0:
                    self._router.is_silent = True
                    raise no_answer(
                        f"the daemon did not answer {what()}", timeout_s, self._router.here
                    )
                if watch is not None:
                    watch.look()
                if self._may_lead(me):
                    self._read(min(remaining_s, SLICE_S))
                    self._wake_followers()
                else:
                    self._follow(inbox, min(remaining_s, SLICE_S))
        finally:
            self._stop_leading(me)

    def poll(self) -> None:
        """Route what has come already; raises `ConnectError` when the connection has ended."""
        me = threading.get_ident()
        try:
            if self._router.ending is None and self._may_lead(me):
                self._read(0.0)
        finally:
            self._stop_leading(me)
        self._router.check(is_asked_late=True)

    def drain(self) -> None:
        """Route all that has come already, and nothing else."""
        me = threading.get_ident()
        try:
            while self._router.ending is None and self._stream.has_more and self._may_lead(me):
                self._read(0.0)
        finally:
            self._stop_leading(me)

    def _may_lead(self, me: int) -> bool:
        with self._lock:
            if self._leader is None:
                self._leader = me
            return self._leader == me

    def _stop_leading(self, me: int) -> None:
        if self._leader == me:
            self._leader = None
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


_WAYS = (Multiplexer.ask, Multiplexer.wait, Multiplexer.poll, Multiplexer.drain)
_WAITING = {way.__code__ for way in _WAYS}


class Connection(Exchange):
    """A connection to the daemon at the socket `socket_path`.

    Threads may share it. Processes may not: after a fork the child makes its own.
    """

    def __init__(self, socket_path: str, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """Connect; raises `OSError`. `timeout_s` is the default time limit of calls."""
        super().__init__(socket_path, timeout_s)
        self._multiplexer = Multiplexer(socket_path, timeout_s, self._router)

    def call(
        self,
        method: str,
        params: Mapping[str, Any] | None = None,
        timeout_s: float | None = None,
        on_progress: Progress | None = None,
    ) -> dict[str, Any]:
        """Send a request to the daemon and return its result.

        `timeout_s` None means the connection's default, `math.inf` means no limit. `on_progress`
        is called in this thread with the parameters of each progress notification of this
        request (request them by `"progress": True`). It may make calls itself. Raises the
        exception of the daemon's error, and `ConnectError` when the connection is lost or no
        answer comes in time. An answer that comes after an interrupt or a time-out is dropped;
        the connection stays usable.
        """
        return self.run(Call(next(self._ids), method, params, on_progress), timeout_s)

    def command(
        self, method: str, params: Mapping[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call that must never act after a stop that this program did not know of."""
        return self.run(self.prepare_guarded(method, params), timeout_s)

    def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a prepared call and wait for its result, as described for `call`."""
        multiplexer, calls = self._multiplexer, self._router.calls
        multiplexer.check_usable()
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        line = request_line(call.identity, call.method, call.params)
        since_s = time.monotonic()
        watch = Watch(self, call) if limit_s > DEFAULT_TIMEOUT_S else None
        try:
            call.is_sent = True
            calls[call.identity] = call
            answer = multiplexer.ask(call, line, self.timeout_s, limit_s)
            if answer is not None:
                return self._result(answer, call.method)
            while True:
                multiplexer.wait(
                    call.inbox, limit_s, lambda: self.asked_by(call.method), since_s, watch
                )
                is_report = "method" in call.inbox[0]
                result = self._take(call)
                if result is not None:
                    return result
                if is_report:
                    since_s = time.monotonic()
                if watch is not None:
                    watch.restart()
        finally:
            if watch is not None:
                watch.end()
            if not call.keep:
                calls.pop(call.identity, None)

    def _post(self, line: bytes) -> None:
        self._multiplexer.send(line, self.timeout_s)

    def notify_guarded(self, method: str, params: Mapping[str, Any]) -> None:
        """Send, as `prepare_guarded` does, a request that gets no answer.

        Raises `ConnectError` when the connection is gone. Look at `take_refusal` before.
        """
        self._multiplexer.check_usable()
        self._post(self._guarded_notification(method, params))

    def take_refusal(self) -> LiteGripError | None:
        """Return the daemon's refusal of a `notify_guarded` request, or None."""
        self._multiplexer.check_usable()
        self._multiplexer.poll()
        return self._newest_refusal()

    def greet(self, client: str) -> dict[str, Any]:
        """Send `hello`; return what the daemon says of itself. Checks the protocol's version."""
        hello = self.call("hello", {"client": client})
        self.accept(hello)
        return hello

    def subscribe_state(
        self, hz: float = 20.0, fields: Sequence[str] | None = None, batch: int = 1
    ) -> Subscription[StateSample]:
        """Subscribe to the state, or to some `fields` of it, `hz` times a second (0.1 to 200).

        Up to 50 samples may come as a `batch`; each is still a `StateSample`.
        """
        from litegrip_client.line.feeds import StateFeed  # noqa: PLC0415 - see above

        return self.subscribe(StateFeed(hz, fields, lambda sample: sample, batch=batch))

    def subscribe_events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Subscribe to the gripper's events, or only to some `kinds`."""
        from litegrip_client.line.feeds import EventFeed, EventSubscription  # noqa: PLC0415

        feed = EventFeed(kinds)
        self.begin(feed)
        return EventSubscription(self, feed)

    def subscribe(self, feed: Feed[_Item]) -> Subscription[_Item]:
        """Begin the subscription of a feed."""
        from litegrip_client.line.feeds import Subscription  # noqa: PLC0415 - see above

        self.begin(feed)
        return Subscription(self, feed)

    def begin(self, feed: Feed[Any]) -> None:
        """Begin the subscription of a feed: its inbox fills while somebody reads here."""
        if feed.asks_first is not None:
            feed.learn(self.call(feed.asks_first))
        call = self._subscribing(feed)
        try:
            self.run(call)
        except BaseException:
            self._abandon_subscribing(call, feed)
            raise

    def wait_for(self, feed: Feed[Any], timeout_s: float) -> None:
        """Wait until a feed has something in its inbox, of what has come already the newest."""
        self._multiplexer.check_usable()
        if feed.is_newest_wanted:
            self._multiplexer.drain()
        self._multiplexer.wait(
            feed.inbox, timeout_s, lambda: f"with a {feed.what}", time.monotonic()
        )

    def listen(self, notification: str, listener: Listener) -> None:
        """Hand notifications that belong to no subscription to a listener, held weakly."""
        self._router.listeners[notification, 0] = ref(listener)

    def unlisten(self, notification: str) -> None:
        """End `listen`; again does nothing."""
        self._router.listeners.pop((notification, 0), None)

    def unsubscribe(self, feed: Feed[Any]) -> None:
        """End a subscription; there is nothing to do when the connection has ended.

        A silent daemon is not waited for: what came of that has been raised.
        """
        is_silent = self.is_silent
        try:
            with contextlib.suppress(ConnectError) if is_silent else or_closed():
                if feed.key in self._router.listeners and not self.closed:
                    (self.post if is_silent else self.call)(*feed.ending())
        finally:
            self._router.listeners.pop(feed.key, None)

    def check_open(self) -> None:
        """Raise `ConnectError` when nothing more can come here."""
        self._multiplexer.check_open()

    @property
    def closed(self) -> bool:
        """True if the connection has ended: every further call fails."""
        return self._multiplexer.closed

    @property
    def is_own(self) -> bool:
        """True if this process made the connection, not the parent process before a fork."""
        return self._multiplexer.is_own

    @property
    def daemon_pid(self) -> int:
        """The process id of the other end, 0 if unknown."""
        return self._multiplexer.daemon_pid

    @property
    def is_waiting_here(self) -> bool:
        """True in a signal handler that interrupts a call of its own thread."""
        return self._multiplexer.is_waiting_here

    def close(self) -> None:
        """End the connection; again does nothing. In a forked child only its copy is closed."""
        self._multiplexer.close()

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
