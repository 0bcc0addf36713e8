"""`LiteGrip` for asyncio: the core's gripper, on connections that suspend the task that waits."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Generic, TypeVar, overload

from litegrip_client.aio.connection import Connection
from litegrip_client.calibration import GripperConfig
from litegrip_client.core.actions import GripperActions
from litegrip_client.core.gripper import Gripper
from litegrip_client.core.session import DaemonSession
from litegrip_client.discovery import reach
from litegrip_client.feeds import Event, EventFeed, Feed, StateFeed, some_fields, whole_state
from litegrip_client.motion_config import MotionConfig
from litegrip_client.results import GripperState
from litegrip_client.sdk.expected import expectations
from litegrip_client.warn import leave

_Item = TypeVar("_Item")


class Subscription(Generic[_Item]):
    """Iterate to get each item as it comes: `async for state in gripper.states(hz=50):`.

    It begins with the iteration, or with `async with`, whose end ends it. One that nobody has any
    more, because its iteration was left, is ended when the next item comes for it.
    """

    def __init__(self, connection: Connection, feed: Feed[_Item]) -> None:
        self._connection = connection
        self._feed = feed
        self._begun = False
        self._closed = False

    async def _begin(self) -> None:
        if self._begun:
            return
        self._begun = True
        try:
            await self._connection.subscribe(self._feed)
        except BaseException:
            self._begun = False
            raise

    def __aiter__(self) -> Subscription[_Item]:
        return self

    async def __anext__(self) -> _Item:
        """Wait for the next item; raises `ConnectError` when the daemon is gone or silent."""
        if self._closed:
            raise StopAsyncIteration
        await self._begin()
        limit_s = self._connection.timeout_s + self._feed.silence_s
        await self._connection.wait_for(self._feed, limit_s)
        item = self._feed.take()
        if item is None:
            raise StopAsyncIteration
        return item

    async def close(self) -> None:
        """End the subscription, also for a task that waits for an item. Again does nothing."""
        if not self._closed:
            self._closed = True
            self._feed.end()
            await self._connection.unsubscribe(self._feed)

    async def __aenter__(self) -> Subscription[_Item]:
        await self._begin()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await leave(self.close, error)


class EventSubscription(Subscription[Event]):
    """A subscription to events: what happens from its begin on."""

    def __init__(self, connection: Connection, feed: EventFeed) -> None:
        super().__init__(connection, feed)
        self._events = feed

    @property
    def recent(self) -> tuple[Event, ...]:
        """The last events before the begin, the oldest first; the daemon keeps 32."""
        return self._events.recent

    async def __aenter__(self) -> EventSubscription:
        await self._begin()
        return self


_Result = TypeVar("_Result")

_KEPT_S = 0.5
"""What a slow task finds of the states that came meanwhile: it shall get new ones."""


class AsyncSession(DaemonSession):
    """A daemon, by channel, and the connection to it while there is one."""

    async def _connect(self) -> Connection:
        return await reach(self.channel, self.socket_path, Connection.open)

    async def reach(self, path: str, timeout_s: float) -> Connection:
        """Connect to another socket of the same daemon; raises `OSError`."""
        return await Connection.open(path, timeout_s)

    async def aside(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """Return what `function` does, in a thread of its own."""
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


class LiteGrip(Gripper):
    """The gripper on `channel`, as `async with LiteGrip("can0") as gripper:`.

    The arguments are those of `litegrip_client.LiteGrip`, and so are all other names; `progress`
    is called in the event loop, and must not block it. The constructor connects to nothing.
    """

    _session: AsyncSession

    def __init__(
        self,
        channel: str = "can0",
        can_id: int | None = None,
        *,
        mount: str | None = None,
        disable_on_disconnect: bool = True,
        socket_path: str | None = None,
        motion_config: MotionConfig | None = None,
        mst_id: int | None = None,
        canfd_mode: bool | None = None,
        motor_type: str | int | None = None,
        config: GripperConfig | None = None,
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
        )
        super().__init__(session, mount, motion_config)

    async def __aenter__(self) -> LiteGrip:
        await self.connect()
        return self

    @property
    def actions(self) -> GripperActions:
        """The actions by themselves, which this object has as well."""
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
            return Subscription(connection, StateFeed(hz, None, whole_state, _KEPT_S, batch))
        return Subscription(connection, StateFeed(hz, fields, some_fields, _KEPT_S, batch))

    def events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Iterate over what happens from the begin of the iteration on, or only some `kinds`."""
        return EventSubscription(self._session.connection, EventFeed(kinds))
