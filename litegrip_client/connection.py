"""Calls and subscriptions over one connection to the daemon, for any number of threads.

This module handles JSON-RPC and what all requests have in common. It must not know what the
methods do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType

from litegrip_client.calls import Call, Progress
from litegrip_client.errors import LiteGripError
from litegrip_client.exchange import DEFAULT_TIMEOUT_S, Exchange
from litegrip_client.multiplexer import Multiplexer

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from typing import Any, TypeVar

    from litegrip_client.feeds import Feed
    from litegrip_client.subscription import EventSubscription, StateSample, Subscription

    _Item = TypeVar("_Item")


class Connection(Exchange):
    """A connection to the daemon at the socket `path`.

    Threads may share it. Processes may not: after a fork the child makes its own.
    """

    def __init__(self, path: str, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """Connect; raises `OSError`. `timeout_s` is the default time limit of calls."""
        super().__init__(path, timeout_s)
        self._multiplexer = Multiplexer(path, timeout_s, self._router)

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
        return self.run(self.prepare(method, params, on_progress), timeout_s)

    def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a prepared call and wait for its result, as described for `call`."""
        multiplexer = self._multiplexer
        multiplexer.check_usable()
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        line = call.line()
        try:
            self._router.calls[call.identity] = call
            multiplexer.send(line, self.timeout_s)
            while True:
                multiplexer.wait(call.inbox, limit_s, call.method)
                result = self._take(call)
                if result is not None:
                    return result
        finally:
            if not call.keep:
                self.forget(call)

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
        from litegrip_client.samples import StateFeed  # noqa: PLC0415 - see above

        return self.subscribe(StateFeed(hz, fields, lambda sample: sample, batch=batch))

    def subscribe_events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Subscribe to the gripper's events, or only to some `kinds`."""
        from litegrip_client.feeds import EventFeed  # noqa: PLC0415 - see above
        from litegrip_client.subscription import EventSubscription  # noqa: PLC0415

        feed = EventFeed(kinds)
        self._begin(feed)
        return EventSubscription(self, feed)

    def subscribe(self, feed: Feed[_Item]) -> Subscription[_Item]:
        """Begin the subscription of a feed."""
        from litegrip_client.subscription import Subscription  # noqa: PLC0415 - see above

        self._begin(feed)
        return Subscription(self, feed)

    def _begin(self, feed: Feed[Any]) -> None:
        call = self._subscribing(feed)
        try:
            self.run(call)
        except BaseException:
            self._abandon_subscribing(call, feed)
            raise

    def wait_for(self, feed: Feed[Any], timeout_s: float) -> None:
        """Wait until a feed has something in its inbox."""
        self._multiplexer.check_usable()
        self._multiplexer.wait(feed.inbox, timeout_s, f"with a {feed.what}")

    def unsubscribe(self, feed: Feed[Any]) -> None:
        """End a subscription; there is nothing to do when the connection has ended."""
        try:
            if feed.key in self._router.listeners and not self.closed:
                self.call(*feed.ending())
        finally:
            self._router.listeners.pop(feed.key, None)

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
