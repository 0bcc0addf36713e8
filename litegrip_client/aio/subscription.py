"""Asynchronous iterators over what subscriptions bring."""

from __future__ import annotations

from types import TracebackType
from typing import Generic, TypeVar

from litegrip_client.aio.connection import Connection
from litegrip_client.feeds import Event, EventFeed, Feed
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
