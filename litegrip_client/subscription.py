"""Iterators over what subscriptions bring, for threads.

The daemon decides what a slow reader misses; this module only hands on what came. It must not
read the connection by itself.
"""

from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar

from litegrip_client.feeds import Event, EventFeed, Feed, StateSample

__all__ = ["Event", "EventSubscription", "StateSample", "Subscription"]

_Item = TypeVar("_Item")


class FeedSource(Protocol):
    """What a subscription needs of its connection."""

    timeout_s: float

    def wait_for(self, feed: Feed[Any], timeout_s: float) -> None:
        """Wait until the feed's inbox holds something."""

    def unsubscribe(self, feed: Feed[Any]) -> None:
        """End the subscription of this feed."""


class Subscription(Generic[_Item]):
    """Iterate to get each item as it comes; close it when done.

    One that nobody has any more is ended as well, when the next item comes for it.
    """

    def __init__(self, source: FeedSource, feed: Feed[_Item]) -> None:
        self._source = source
        self._feed = feed
        self._closed = False

    def __iter__(self) -> "Subscription[_Item]":
        return self

    def __next__(self) -> _Item:
        """Wait for the next item; raises `ConnectError` when the daemon is gone or silent."""
        if self._closed:
            raise StopIteration
        self._source.wait_for(self._feed, self._source.timeout_s + self._feed.silence_s)
        item = self._feed.take()
        if item is None:
            raise StopIteration
        return item

    def close(self) -> None:
        """End the subscription, also for a thread that waits for an item. Again does nothing."""
        if not self._closed:
            self._closed = True
            self._feed.end()
            self._source.unsubscribe(self._feed)

    def __enter__(self) -> "Subscription[_Item]":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class EventSubscription(Subscription[Event]):
    """A subscription to events: what happens from its begin on."""

    def __init__(self, source: FeedSource, feed: EventFeed) -> None:
        super().__init__(source, feed)
        self._events = feed

    @property
    def recent(self) -> tuple[Event, ...]:
        """The last events before the begin, the oldest first; the daemon keeps 32."""
        return self._events.recent

    def __enter__(self) -> "EventSubscription":
        return self
