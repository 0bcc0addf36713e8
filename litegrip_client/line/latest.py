"""The newest state, kept up to date by one subscription: read at any time, without asking.

A thread of its own receives what comes, so that a program that looks seldom finds a new state, not
the oldest one that waits in a socket.
"""

from __future__ import annotations

import contextlib
import threading
import time
from typing import TYPE_CHECKING
from weakref import ref

from litegrip_client.line.exchange import FOREVER_S, no_answer
from litegrip_client.line.feeds import Feed, anew
from litegrip_client.values.checks import number, time_limit
from litegrip_client.values.errors import ConnectError, LiteGripError
from litegrip_client.values.fields import Hinting
from litegrip_client.values.results import GripperState
from litegrip_client.values.terms import Called
from litegrip_client.values.tracebacks import shortened

if TYPE_CHECKING:
    from litegrip_client.line.connection import Connection
    from litegrip_client.line.exchange import Exchange, Message


class NewestFeed(Feed[GripperState]):
    """Of all states that come the newest one; `count` is how many have come.

    `is_over` is true once it was ended. Its inbox only says that one has come. One thread delivers
    while others read.
    """

    notification = "state.sample"
    method = "state.subscribe"
    what = "state sample"

    def __init__(self, hz: float) -> None:
        """Raise `CommandError` for what is no rate."""
        hz = number("hz", hz)
        super().__init__({"hz": hz}, 1.0 / hz if hz > 0.0 else 0.0, 1)
        self.count = 0
        self.is_over = False
        self._newest_seq = -1
        self._came: tuple[Message, float] | None = None
        self._read: tuple[Message, GripperState] | None = None

    def begin(self, result: Message) -> None:
        """Take the subscription's number and the present state."""
        if self.identity < 0:
            self._take(result["state"])
            self.identity = result["subscription"]

    def deliver(self, message: Message) -> None:
        """Take one sample."""
        if message["seq"] > self._newest_seq:
            self._newest_seq = message["seq"]
            self._take(message["state"])

    def _take(self, state: Message) -> None:
        self._came = state, time.monotonic()
        self.count += 1
        self.inbox.append(None)

    def end(self) -> None:
        """End the feed: nothing more comes."""
        self.is_over = True
        super().end()

    @property
    def state(self) -> GripperState:
        """The newest state; raises `ProtocolError`, and `ConnectError` before there is one."""
        data, _ = self._newest()
        read = self._read
        if read is None or read[0] is not data:
            self._read = read = data, GripperState.from_wire(data)
        return read[1]

    def age_s(self, *, has_clock: bool) -> float:
        """Return how old the newest state is, as `Exchange.has_clock` allows to say it."""
        data, came_s = self._newest()
        return time.monotonic() - (data["monotonic_s"] if has_clock else came_s)

    def _newest(self) -> tuple[Message, float]:
        if self._came is None:
            raise not_begun()
        return self._came


def not_begun() -> ConnectError:
    """Return the error for a look at states that do not come yet, or no longer."""
    return ConnectError(
        "latest() has no state: it has not begun, or was closed",
        reason="not_connected",
        data={"hint": "read it inside the block of gripper.latest()"},
    )


class BaseLatest(Hinting):
    """The newest state: what can be said of it without waiting."""

    def _beyond(self) -> dict[str, type]:
        return {"state.": GripperState}

    def __init__(self, connection: Exchange, feed: NewestFeed) -> None:
        self._exchange = connection
        self._feed = feed

    def __repr__(self) -> str:
        return f"<Latest of {self._feed!r}{', closed' if self._feed.is_over else ''}>"

    @property
    def state(self) -> GripperState:
        """The newest state that has come; reading it never waits, nor asks the daemon.

        Look at `age_s`: a daemon that hangs sends no more. Raises `ConnectError` when the
        connection has ended, and after `close`.
        """
        self._check()
        return self._feed.state

    @property
    def age_s(self) -> float:
        """How old the newest state is by now, in seconds. Raises as `state` does.

        Through a portal it counts from the arrival here: the way is not in it.
        """
        self._check()
        return self._feed.age_s(has_clock=self._exchange.has_clock)

    @property
    def feedback_age_s(self) -> float | None:
        """How old the motor's feedback in it is by now; None if there never was any.

        It is what to refuse old figures by, also through a portal. Raises as `state` does.
        """
        then_s = self.state.age_s
        return None if then_s is None else then_s + self.age_s

    def _limit_s(self, timeout: float | None) -> float:
        if timeout is None:
            return self._exchange.timeout_s + self._feed.silence_s
        return time_limit("timeout", timeout)

    def _check(self) -> None:
        if self._feed.is_over:
            raise not_begun()
        try:
            self._exchange.check_open()
        except ConnectError as error:  # also of a forked child, which has to connect, too
            anew(error, Called(self._feed.method, "latest"), self._exchange.voice)
            raise


@shortened
class Latest(BaseLatest):
    """The newest state: `with gripper.latest() as latest:`. Threads may share it.

    One that is no longer referenced ends when its next state comes.
    """

    def __init__(self, connection: Connection, feed: NewestFeed) -> None:
        """`feed` has begun."""
        super().__init__(connection, feed)
        self._connection = connection
        self._changed = threading.Condition()
        threading.Thread(
            target=_receive,
            args=(connection, feed, self._changed, ref(self)),
            name="litegrip latest",
            daemon=True,
        ).start()

    def wait_newer(self, timeout: float | None = None) -> GripperState:
        """Wait for a state that is newer than the present one; return it.

        Raises `ConnectError` when none comes within `timeout` seconds (`no_answer`; five and more
        by default), when the connection has ended, and after `close`.
        """
        feed, before = self._feed, self._feed.count
        limit_s = self._limit_s(timeout)
        ends_s = time.monotonic() + limit_s
        with self._changed:
            while feed.count == before:
                self._check()
                remaining_s = ends_s - time.monotonic()
                if remaining_s <= 0.0:
                    raise no_answer(
                        f"the daemon did not answer with a {feed.what}",
                        limit_s,
                        self._connection.here,
                    )
                self._changed.wait(remaining_s)
        return self.state

    def close(self) -> None:
        """End the subscription, also for a thread that waits. Again does nothing."""
        if not self._feed.is_over:
            self._feed.end()
            with self._changed:
                self._changed.notify_all()
            self._connection.unsubscribe(self._feed)

    def __enter__(self) -> Latest:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _receive(
    connection: Connection,
    feed: NewestFeed,
    changed: threading.Condition,
    owner: ref[Latest],
) -> None:
    """Receive until the end of the owner, or of the connection, of which the owner hears itself."""
    with contextlib.suppress(LiteGripError):
        while owner() is not None and not feed.is_over:
            connection.wait_for(feed, FOREVER_S)
            feed.inbox.clear()
            with changed:
                changed.notify_all()
        if owner() is None:
            connection.unsubscribe(feed)
    with changed:
        changed.notify_all()
