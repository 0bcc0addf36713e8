"""`LiteGrip` for asyncio: the core's gripper, on connections that suspend the task that waits.

`Connection` adds a stream and waiting, both on asyncio, to what `Exchange` is. It must not know
what the methods do.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import functools
import inspect
import math
import os
import socket
from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, NoReturn, TypeVar, overload

from litegrip_client.core.actions import GripperActions
from litegrip_client.core.discovery import reach
from litegrip_client.core.expected import expectations
from litegrip_client.core.gripper import Gripper, no_member
from litegrip_client.core.session import AsyncBlock, DaemonSession
from litegrip_client.line.connection import SLICE_S, peer_pid
from litegrip_client.line.exchange import (
    DEFAULT_TIMEOUT_S,
    Call,
    Exchange,
    Watch,
    no_answer,
    or_closed,
)
from litegrip_client.line.feeds import (
    KEPT_S,
    Event,
    EventFeed,
    Feed,
    StateFeed,
    anew,
    ended,
    some_fields,
    whole_state,
)
from litegrip_client.line.latest import BaseLatest, NewestFeed
from litegrip_client.values.calibration import GripperConfig
from litegrip_client.values.errors import CommandError, ConnectError, LiteGripError
from litegrip_client.values.motion_config import MotionConfig
from litegrip_client.values.results import GripperState
from litegrip_client.values.terms import Voice
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.voices import in_python
from litegrip_client.values.warn import leave


class Waiting:
    """The tasks that wait for one connection; every change wakes them."""

    def __init__(self) -> None:
        self._waiting: dict[asyncio.Future[None], Callable[[], bool]] = {}

    async def until(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for `ready` for at most `timeout_s` seconds; return True if it is so."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        while not ready():
            remaining_s = deadline_s - loop.time()
            if remaining_s <= 0.0:
                return False
            # `asyncio.wait_for` may lose a cancelling that comes together with what it waits for.
            waiter: asyncio.Future[None] = loop.create_future()
            timer = None
            if not math.isinf(remaining_s):
                timer = loop.call_later(remaining_s, _wake, waiter)
            self._waiting[waiter] = ready
            try:
                await waiter
            finally:
                del self._waiting[waiter]
                if timer is not None:
                    timer.cancel()
        return True

    def wake(self) -> None:
        """Wake the waiters whose condition is true by now."""
        for waiter, ready in self._waiting.items():
            if ready():
                _wake(waiter)


def _wake(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)


_RETRY_S = 0.01
_READ_BYTES = 65_536


class LineStream(asyncio.Protocol):
    """A connected socket. `on_lines` is called with the complete lines that came together.

    `on_change` is called when `ended` or `is_full` (of what the daemon does not read) changes.
    `peer_pid` is the process at the other end, once connected.
    """

    def __init__(
        self, on_lines: Callable[[list[bytes]], None], on_change: Callable[[], None]
    ) -> None:
        """Nothing is connected yet."""
        self.ended = False
        self.is_full = False
        self.peer_pid = 0
        self._on_lines = on_lines
        self._on_change = on_change
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._transport: asyncio.WriteTransport | None = None
        self._rest = b""

    async def connect(self, path: str, timeout_s: float) -> None:
        """Connect to `path`; raises `OSError` when that fails or takes over `timeout_s`."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        try:
            self._socket.setblocking(False)
            # asyncio would take a full queue of the daemon for a success.
            while (number := self._socket.connect_ex(path)) == errno.EAGAIN:
                if loop.time() >= deadline_s:
                    break
                await asyncio.sleep(_RETRY_S)
            if number != 0:
                raise OSError(number, os.strerror(number))
            self.peer_pid = peer_pid(self._socket)
            await loop.create_unix_connection(lambda: self, sock=self._socket)
        except BaseException:
            self._socket.close()
            raise

    def send(self, line: bytes) -> None:
        """Send a line with its newline, or keep it to be sent; nothing when it has ended."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(line)

    def abort(self) -> None:
        """End the connection soon; `ended` reports its end. What waits to be sent is dropped."""
        if self._transport is not None:
            self._transport.abort()

    def close_here(self) -> None:
        """Close the socket without the event loop, which is gone, or a parent process's."""
        self._socket.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport."""
        if isinstance(transport, asyncio.WriteTransport):
            self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Pass the complete lines on."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if lines:
            self._on_lines(lines)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note the end, after what the daemon said before a sending failed."""
        if exc is not None:
            with contextlib.suppress(OSError):
                while data := self._socket.recv(_READ_BYTES):
                    self.data_received(data)
        self.ended = True
        self._on_change()

    def pause_writing(self) -> None:
        """Note that the daemon does not read."""
        self.is_full = True
        self._on_change()

    def resume_writing(self) -> None:
        """Note that it reads again."""
        self.is_full = False
        self._on_change()


class Connection(Exchange):
    """A connection to the daemon, for the tasks of the event loop in which it was opened."""

    def __init__(self, socket_path: str, timeout_s: float) -> None:
        """Nothing is connected yet; see `open`."""
        super().__init__(socket_path, timeout_s)
        self._loop = asyncio.get_running_loop()
        self._pid = os.getpid()
        self._waiting = Waiting()
        self._stream = LineStream(self._on_lines, self._on_change)

    @classmethod
    async def open(cls, socket_path: str, timeout_s: float = DEFAULT_TIMEOUT_S) -> Connection:
        """Connect to the socket `socket_path`; raises `OSError`.

        `timeout_s` limits the connecting, and the calls that do not say otherwise.
        """
        connection = cls(socket_path, timeout_s)
        await connection._stream.connect(socket_path, timeout_s)
        return connection

    @property
    def connection(self) -> Connection:
        """This object: it has both what waits and what does not."""
        return self

    # Calls

    def call(
        self, method: str, params: Mapping[str, Any] | None = None, timeout_s: float | None = None
    ) -> Coroutine[Any, Any, dict[str, Any]]:
        """Send a request to the daemon and return its result.

        `timeout_s` None means the connection's, `math.inf` for ever. Raises the exception of the
        daemon's error, and `ConnectError` when the connection is gone or no answer comes in time.
        """
        return self.run(self.prepare(method, params), timeout_s)

    async def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a prepared call and wait for its result, as described for `call`."""
        self._check_usable()
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        line = call.line()
        watch = Watch(self, call) if limit_s > DEFAULT_TIMEOUT_S else None
        since_s = self._loop.time()
        try:
            call.is_sent = True
            self._router.calls[call.identity] = call
            if self._stream.is_full:
                await self._wait_for_room()
            self._stream.send(line)
            while True:
                await self.wait_until(
                    lambda: bool(call.inbox),
                    limit_s,
                    lambda: self.asked_by(call.method),
                    since_s,
                    watch,
                )
                is_report = "method" in call.inbox[0]
                result = self._take(call)
                if result is not None:
                    return result
                if is_report:
                    since_s = self._loop.time()
                if watch is not None:
                    watch.restart()
        finally:
            if watch is not None:
                watch.end()
            if not call.keep:
                self.forget(call)

    async def notify_guarded(self, method: str, params: Mapping[str, Any]) -> None:
        """Send, as `prepare_guarded` does, a request that gets no answer."""
        self._check_usable()
        if self._stream.is_full:
            await self._wait_for_room()
        self._stream.send(self._guarded_notification(method, params))

    async def take_refusal(self) -> LiteGripError | None:
        """Return the daemon's refusal of a `notify_guarded` request, or None."""
        self._check_usable()
        await asyncio.sleep(0)  # so that what has come is read, and other tasks have their turn
        self._router.check(is_asked_late=True)
        return self._newest_refusal()

    async def finish(self, begin: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Await what `begin` returns, to its end even when the task is cancelled again."""
        task = asyncio.get_running_loop().create_task(begin())
        cancelled: asyncio.CancelledError | None = None
        while not task.done():
            try:
                await asyncio.wait([task])
            except asyncio.CancelledError as error:  # noqa: PERF203 - hardly ever more than one
                cancelled = error
        task.result()
        if cancelled is not None:
            raise cancelled

    # Subscriptions

    async def subscribe(self, feed: Feed[Any]) -> None:
        """Begin the subscription of a feed."""
        if feed.asks_first is not None:
            feed.learn(await self.call(feed.asks_first))
        call = self._subscribing(feed)
        try:
            await self.run(call)
        except BaseException:
            self._abandon_subscribing(call, feed)
            raise

    async def wait_for(self, feed: Feed[Any], timeout_s: float) -> None:
        """Wait until a feed has something in its inbox."""
        await self.wait_until(lambda: bool(feed.inbox), timeout_s, lambda: f"with a {feed.what}")

    async def unsubscribe(self, feed: Feed[Any]) -> None:
        """End a subscription; there is nothing to do when the connection has ended.

        A silent daemon is not waited for: what came of that has been raised.
        """
        self._waiting.wake()
        if self._router.listeners.pop(feed.key, None) is None or self.closed:
            return
        if self.is_silent:
            with contextlib.suppress(ConnectError):
                self.post(*feed.ending())
        else:
            with or_closed():
                await self.call(*feed.ending())

    # The connection itself

    @property
    def closed(self) -> bool:
        """True if the connection has ended: every further call fails."""
        return self._router.ending is not None or self._loop.is_closed() or not self.is_own

    def check_open(self) -> None:
        """Raise `ConnectError` when nothing more can come here."""
        self._router.check(is_asked_late=True)

    @property
    def daemon_pid(self) -> int:
        """The process id of the other end, 0 if unknown."""
        return self._stream.peer_pid

    @property
    def is_own(self) -> bool:
        """True if this process made the connection, not the parent process before a fork."""
        return os.getpid() == self._pid

    async def close(self) -> None:
        """End the connection; again does nothing. In a forked child only its copy is closed."""
        if not self.is_own or self._loop.is_closed():
            self._router.end("this connection was closed", "closed")
            self._stream.close_here()
        elif asyncio.get_running_loop() is self._loop:
            self._abort()
            await self._waiting.until(lambda: self._stream.ended, self.timeout_s)
        else:
            self._loop.call_soon_threadsafe(self._abort)

    def _abort(self) -> None:
        self._router.end("this connection was closed", "closed")
        self._stream.abort()
        self._waiting.wake()

    def _check_usable(self) -> None:
        self._check_loop()
        self._router.check(is_asked_late=True)

    def _check_loop(self) -> None:
        if asyncio.get_running_loop() is not self._loop:
            raise CommandError(
                "this connection belongs to another event loop",
                reason="wrong_loop",
                data={"hint": "connect again in each event loop, after having disconnected"},
            )

    async def _wait_for_room(self) -> None:
        if not await self._waiting.until(self._has_room, self.timeout_s):
            raise no_answer("the daemon does not read its requests", self.timeout_s, self.here)
        self._router.check()

    def _has_room(self) -> bool:
        return not self._stream.is_full or self._stream.ended

    def _post(self, line: bytes) -> None:
        self._stream.send(line)

    async def wait_until(
        self,
        came: Callable[[], bool],
        timeout_s: float,
        what: Callable[[], str],
        since_s: float | None = None,
        watch: Watch | None = None,
    ) -> None:
        """Return when something has come; raises `ConnectError` when it cannot come.

        That is, by `timeout_s` after `since_s` (now), or when `watch` says so.
        """
        self._check_loop()
        is_late = self._router.ending is not None

        def ready() -> bool:
            return came() or self._router.ending is not None

        ends_s = timeout_s + (self._loop.time() if since_s is None else since_s)
        while True:
            remaining_s = ends_s - self._loop.time()
            wait_s = remaining_s if watch is None else min(remaining_s, SLICE_S)
            if await self._waiting.until(ready, wait_s):
                break
            if watch is None or wait_s == remaining_s:
                self.note_silence()
                raise no_answer(f"the daemon did not answer {what()}", timeout_s, self.here)
            watch.look()
        if not came():
            self._router.check(is_asked_late=is_late)

    def _on_lines(self, lines: list[bytes]) -> None:
        complaint = self._router.take(lines)
        if complaint is not None:
            self._router.end(complaint, "connection_lost")
            self._stream.abort()
        self._waiting.wake()

    def _on_change(self) -> None:
        if self._stream.ended:
            self._router.end("the daemon ended the connection", "connection_lost")
        self._waiting.wake()


_Item = TypeVar("_Item")


_FeedT = TypeVar("_FeedT", bound=Feed[Any])


class _BegunLate(AsyncBlock, Generic[_FeedT]):
    """What subscribes when somebody first waits for it, and again if that has failed."""

    _connection: Connection
    _feed: _FeedT
    _begun = False

    async def _begin(self) -> None:
        if self._begun:
            return
        self._begun = True
        try:
            await self._connection.subscribe(self._feed)
        except BaseException:
            self._begun = False
            raise


@shortened
class Subscription(_BegunLate[Feed[_Item]], Generic[_Item]):
    """Iterate to get each item as it comes: `async for state in gripper.states(hz=50):`.

    It begins with the iteration, or with `async with`, whose end ends it. A subscription that is no
    longer referenced, because its iteration was left, ends when its next item comes.
    """

    def __init__(self, connection: Connection, feed: Feed[_Item]) -> None:
        self._connection = connection
        self._feed = feed
        self._closed = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._feed!r}{', closed' if self._closed else ''}>"

    if not TYPE_CHECKING:  # else a type checker would allow it

        def __iter__(self) -> NoReturn:
            raise TypeError(f"this {type(self).__name__} is for asyncio: `async for`")

    def __aiter__(self) -> Subscription[_Item]:
        """Begin to iterate; raises `ConnectError` once it has ended: nothing would come."""
        if self._closed:
            raise ended(self._feed, self._connection.voice)
        return self

    async def __anext__(self) -> _Item:
        """Wait for the next item; raises `ConnectError` when the daemon is gone or silent."""
        if self._closed:
            raise StopAsyncIteration
        limit_s = self._connection.timeout_s + self._feed.silence_s
        try:
            await self._begin()
            await self._connection.wait_for(self._feed, limit_s)
        except ConnectError as error:
            if self._connection.closed:
                anew(error, self._feed.method, self._connection.voice)
            raise
        item = self._feed.take()
        if item is None:
            raise StopAsyncIteration
        return item

    @property
    def dropped(self) -> int:
        """How many items this reader has missed up to the newest that it got.

        It was too slow, or the daemon had no time to send them (`health` has its late ticks).
        """
        return self._feed.dropped

    async def close(self) -> None:
        """End the subscription, also for a task that waits for an item. Again does nothing."""
        if not self._closed:
            self._closed = True
            self._feed.end()
            await self._connection.unsubscribe(self._feed)

    async def __aenter__(self) -> Subscription[_Item]:
        await self._begin()
        return self

    async def __aexit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        await leave(self.close, error)


@shortened
class EventSubscription(Subscription[Event]):
    """A subscription to events: what happens from its begin on."""

    def __init__(self, connection: Connection, feed: EventFeed) -> None:
        super().__init__(connection, feed)
        self._events = feed

    @property
    def recent(self) -> tuple[Event, ...]:
        """The last events before the begin, the oldest first: 32, and of each kind the last 4."""
        return self._events.recent

    async def __aenter__(self) -> EventSubscription:
        await self._begin()
        return self


@shortened
class Latest(BaseLatest, _BegunLate[NewestFeed]):
    """The newest state: `async with gripper.latest() as latest:`.

    It begins with the block, or with the first `wait_newer`. One that is no longer referenced ends
    when its next state comes.
    """

    def __init__(self, connection: Connection, feed: NewestFeed) -> None:
        super().__init__(connection, feed)
        self._connection = connection

    async def wait_newer(self, timeout: float | None = None) -> GripperState:
        """Wait for a state that is newer than the present one; return it.

        Raises `ConnectError` when none comes within `timeout` seconds (`no_answer`; five and more
        by default), when the connection has ended, and after `close`.
        """
        feed, before = self._feed, self._feed.count
        limit_s = self._limit_s(timeout)
        self._check()
        await self._begin()
        await self._connection.wait_until(
            lambda: feed.is_over or feed.count > before,
            limit_s,
            lambda: f"with a {feed.what}",
        )
        return self.state

    async def close(self) -> None:
        """End the subscription, also for a task that waits. Again does nothing."""
        if not self._feed.is_over:
            self._feed.end()
            await self._connection.unsubscribe(self._feed)

    async def __aenter__(self) -> Latest:
        await self._begin()
        return self

    async def __aexit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        await leave(self.close, error)


_Result = TypeVar("_Result")


class AsyncSession(DaemonSession):
    """A daemon, by channel, and the connection to it while there is one."""

    async def _connect(self) -> Connection:
        left_out, here = self.channel_left_out, self.here
        at = self.chosen, self.socket_path
        return await reach(*at, Connection.open, left_out=left_out, here=here)

    @staticmethod
    def name_call(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        """Name a call of `LiteGrip` as it is made here: who has forgotten an `await` reads it."""
        said = in_python(method, parameter, asked)
        before, dot, call = (said or "").partition("gripper.")
        name, bracket, _ = call.partition("(")
        is_awaited = inspect.iscoroutinefunction(getattr(LiteGrip, name, None))
        if not dot or not (is_awaited or call.endswith(".acquire()")):  # that of a lease
            return said
        return f"{before}await {dot}{call}{'' if bracket else '()'}"

    async def reach(self, path: str, timeout_s: float) -> Connection:
        """Connect to another socket of the same daemon; raises `OSError`."""
        return await Connection.open(path, timeout_s)

    async def run_blocking(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """Run a function in a thread of its own; return its result."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(None, functools.partial(function, *arguments))

    async def pause(self, seconds: float) -> None:
        """Wait for a while; other tasks continue."""
        await asyncio.sleep(seconds)

    @property
    def connection(self) -> Connection:
        """The connection; raises `ConnectError` when there is none."""
        wire = self.wire
        if not isinstance(wire, Connection):
            raise TypeError(f"{wire!r} is no connection of an event loop")
        return wire


@shortened
class LiteGrip(Gripper):
    """The gripper on `channel`, as `async with LiteGrip("can0") as gripper:`.

    The arguments are those of `litegrip_client.LiteGrip`, and so are all other names; `progress`
    is called in the event loop, and must not block it. The constructor connects to nothing.
    """

    _session: AsyncSession

    def __init__(
        self,
        channel: str | None = None,
        can_id: int | None = None,
        *,
        mount: str | None = None,
        disable_on_disconnect: bool = True,
        socket_path: str | None = None,
        motion_config: MotionConfig | None = None,
        mst_id: int | None = None,
        canfd_mode: bool | None = None,
        motor_type: str | None = None,
        config: GripperConfig | None = None,
        voice: Voice | None = None,
    ) -> None:
        """Raise `CommandError` for what cannot be a channel, a mount or a `MotionConfig`."""
        channel, can_id, expected = expectations(
            channel, can_id, mst_id, canfd_mode, motor_type, config
        )
        session = AsyncSession(
            channel,
            can_id,
            socket_path,
            disable_on_disconnect=disable_on_disconnect,
            expected=expected,
            voice=voice,
        )
        super().__init__(session, mount, motion_config, config)

    async def __aenter__(self) -> LiteGrip:
        await self.connect()
        return self

    if not TYPE_CHECKING:  # else a type checker would find every name here

        def __getattr__(self, name: str) -> NoReturn:
            raise no_member(self, name)

        def __setattr__(self, name: str, value: object) -> None:
            """Refuse a name that nothing here reads; a subclass may have others."""
            if type(self) is LiteGrip and name[0] != "_" and not hasattr(LiteGrip, name):
                raise no_member(self, name, is_assigned=True)
            super().__setattr__(name, value)

        def __enter__(self) -> NoReturn:
            """Name the class that was meant."""
            text = (
                "this LiteGrip is for asyncio: `async with`; for `with`: litegrip_client.LiteGrip"
            )
            raise TypeError(text)

        __exit__ = __enter__

    def __repr__(self) -> str:
        what = "connected" if self.is_connected else "not connected"
        return f"<LiteGrip {self.channel}, {what}>"

    @property
    def actions(self) -> GripperActions:
        """The actions without the connection; this object has them, too."""
        return self

    @overload
    def states(
        self, hz: float = 20.0, fields: None = None, batch: int = 1
    ) -> Subscription[GripperState]: ...

    @overload
    def states(
        self, hz: float, fields: Sequence[str], batch: int = 1
    ) -> Subscription[dict[str, Any]]: ...

    def states(self, hz: float = 20.0, fields: Sequence[str] | None = None, batch: int = 1) -> Any:
        """Iterate over states, `hz` times a second (0.1 to 200).

        With `fields`, each is a dictionary of these only. A slow task misses states, but what it
        gets is new. A `batch` of up to 50 spares both sides the work of single messages: the
        states come one by one all the same, but as late as the last of a batch.
        """
        connection = self._session.connection
        if fields is None:
            return Subscription(connection, StateFeed(hz, None, whole_state, KEPT_S, batch))
        return Subscription(connection, StateFeed(hz, fields, some_fields, KEPT_S, batch))

    def events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Iterate over the events from now on, or only those of some `kinds`."""
        return EventSubscription(self._session.connection, EventFeed(kinds))

    def latest(self, hz: float = 50.0) -> Latest:
        """Keep the newest state at hand, `hz` times a second (0.1 to 200), until closed.

        Its `state` never waits, nor asks the daemon: for a loop of its own rate. Use it as
        `async with gripper.latest() as latest:`.
        """
        return Latest(self._session.connection, NewestFeed(hz))
