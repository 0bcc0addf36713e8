"""Subscriptions: events and samples of the state, their inboxes, and the iterators.

Samples may travel in batches; the reader of the inbox does not notice. The daemon decides what a
slow reader misses. No I/O: an iterator, for threads, waits through its connection.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from litegrip_client.line.exchange import Key, Message, unsubscribing
from litegrip_client.values.checks import integer, number
from litegrip_client.values.errors import ConnectError, ParameterError
from litegrip_client.values.fields import unix_time
from litegrip_client.values.results import STATE_FIELDS, GripperState
from litegrip_client.values.terms import Voice, told
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.voices import in_python

_Item = TypeVar("_Item")

_INBOX_EVENTS = 4096
"""Hours of events: a reader with so many unread has stopped reading."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in the gripper: `message` describes it for a person.

    `kind` and `data` describe it for a program. `seq` counts all events since the daemon's start,
    so that a gap shows kinds that were not subscribed; `monotonic_s` is CLOCK_MONOTONIC seconds,
    `timestamp` the same as Unix time.
    """

    seq: int
    monotonic_s: float
    kind: str
    message: str
    data: Mapping[str, Any]

    @property
    def timestamp(self) -> float:
        """The Unix time, by the clocks of this machine, which must be the daemon's, too."""
        return unix_time(self.monotonic_s)

    @classmethod
    def from_wire(cls, data: Mapping[str, Any], voice: Voice = in_python) -> Event:
        """Read the wire's form, in the words of a voice; raises `KeyError` for a missing member."""
        return cls(
            seq=data["seq"],
            monotonic_s=data["monotonic_s"],
            kind=data["kind"],
            message=told(data, "message", voice),
            data=data.get("data") or {},
        )


class Feed(Generic[_Item]):
    """The inbox of one subscription, and how to ask for it.

    `identity` is the daemon's number for it, -1 before it has one. `dropped` counts what was lost
    before the item that was taken last. `silence_s` is the longest time that may pass between two
    items. `what` is the name of an item, and `voice` the connection's.
    """

    notification: str
    method: str
    what: str

    voice: Voice | None = None
    is_newest_wanted = False
    """If the oldest items that a slow reader has not taken yet are to be dropped."""
    asks_first: str | None = None
    """The method whose result `learn` needs before the subscription is asked for."""

    def __init__(self, params: dict[str, Any], silence_s: float, most_items: int | None) -> None:
        self.params = params
        self.silence_s = silence_s
        self.identity = -1
        self.dropped = 0
        self.inbox: deque[Any] = deque(maxlen=most_items)

    def __repr__(self) -> str:
        return ", ".join(
            [f"{self.what}s", *(f"{name}={self.params[name]}" for name in self.params)]
        )

    @property
    def key(self) -> Key:
        """The name under which its notifications come."""
        return self.notification, self.identity

    def ending(self) -> tuple[str, dict[str, Any]]:
        """Return the method and the parameters that end it."""
        return unsubscribing(*self.key)

    def learn(self, result: Message) -> None:
        """Take the result of the method that is asked first."""
        raise NotImplementedError

    def begin(self, result: Message) -> None:
        """Take the answer to the subscription; again does nothing."""
        raise NotImplementedError

    def deliver(self, message: Message) -> None:
        """Take one notification; one that came before is ignored."""
        raise NotImplementedError

    def take(self) -> _Item | None:
        """Return the oldest item of the inbox, which has one; None after the last one."""
        raise NotImplementedError

    def end(self) -> None:
        """End the feed: nothing more comes."""
        self.inbox.append(None)


class EventFeed(Feed[Event]):
    """All events of some `kinds`; `recent` are those from before, the oldest first.

    A reader that lets thousands of them wait gets an error in place of the rest.
    """

    notification = "event"
    method = "events.subscribe"
    what = "event"

    def __init__(self, kinds: Sequence[str] | None) -> None:
        """Raise `CommandError` for impossible kinds."""
        params = {} if kinds is None else {"kinds": names("kinds", kinds)}
        super().__init__(params, math.inf, None)
        self.recent: tuple[Event, ...] = ()
        self._newest_seq = -1
        self._overrun = False

    def begin(self, result: Message) -> None:
        """Take the subscription's number and what happened recently."""
        if self.identity < 0:
            self.recent = tuple(self._event(one) for one in result["events"])
            self._newest_seq = max((one.seq for one in self.recent), default=-1)
            self.identity = result["subscription"]

    def deliver(self, message: Message) -> None:
        """Take one event."""
        event = self._event(message)
        if event.seq <= self._newest_seq or self._overrun:
            return
        if len(self.inbox) < _INBOX_EVENTS:
            self.inbox.append(event)
        else:
            self._overrun = True
            text = f"this program did not read its events: {len(self.inbox)} are waiting"
            self.inbox.append(ConnectError(text, reason="backlog_full"))
        self._newest_seq = event.seq

    def _event(self, data: Message) -> Event:
        return Event.from_wire(data, self.voice or in_python)

    def take(self) -> Event | None:
        """Take the oldest event; raises `ConnectError` when too many were not read."""
        item: Event | ConnectError | None = self.inbox.popleft()
        if isinstance(item, ConnectError):
            self.inbox.append(item)
            raise item
        return item


def names(what: str, given: Sequence[str]) -> list[str]:
    """Return a list of names; raises `CommandError` for a text, whose items are single letters."""
    if isinstance(given, str):
        raise _no_names(what, f"is the text {given!r:.60}")
    try:
        listed = list(given)
    except TypeError:
        raise _no_names(what, f"is {given!r:.60}") from None
    others: list[object] = [one for one in listed if not isinstance(one, str)]
    if others:
        raise _no_names(what, f"has {others[0]!r:.60} in it")
    return listed


def _no_names(what: str, problem: str) -> ParameterError:
    text = f"{what} {problem}, it must be a list of names"
    return ParameterError(text, reason="invalid_params", data={"parameter": what})


KEPT_S = 0.5
"""The most states that wait for a slow reader, in seconds: it should get new ones."""
_INBOX_SAMPLES = 256
"""More than a second at 200 Hz. Only fills while others read the connection, and not this one."""


@dataclass(frozen=True, slots=True)
class StateSample:
    """One sample: `state` holds the subscribed fields. `seq` is None for the first one.

    `seq` and `monotonic_s` (CLOCK_MONOTONIC seconds) are as the daemon sent them; `dropped` counts
    the samples that were lost since the begin, because this program read too slowly or the daemon
    had no time to send them. Where some were lost since the batch before, only the last of a batch
    has its `seq`.
    """

    seq: int | None
    dropped: int
    monotonic_s: float | None
    state: dict[str, Any]


class StateFeed(Feed[_Item]):
    """The state `hz` times a second, each sample converted by `convert`.

    The inbox keeps only the newest `keep_s` seconds. With a `batch` of more than one, that many
    samples come together, as late as the last of them. A batch has to name its fields: without
    `fields` those that the daemon has are asked for, which may be older than this client.
    """

    notification = "state.sample"
    method = "state.subscribe"
    what = "state sample"

    def __init__(
        self,
        hz: float,
        fields: Sequence[str] | None,
        convert: Callable[[StateSample], _Item],
        keep_s: float = math.inf,
        batch: int = 1,
    ) -> None:
        """Raise `CommandError` for an impossible rate, field or size of a batch."""
        hz, batch = number("hz", hz), integer("batch", batch)
        params: dict[str, Any] = {"hz": hz}
        self._fields = None if fields is None else names("fields", fields)
        if self._fields is not None:
            for name in self._fields:
                if name not in STATE_FIELDS and hasattr(GripperState, name):
                    text = (
                        f"fields has {name!r} in it, which only whole states have: leave fields out"
                    )
                    raise ParameterError(
                        text, reason="invalid_params", data={"parameter": "fields"}
                    )
            params["fields"] = self._fields
        self._adds_stamp = False
        if batch != 1:
            self.notification = "state.batch"
            params["batch"] = batch
            if self._fields is None:
                self.asks_first = "state.get"
            else:
                self._adds_stamp = "monotonic_s" not in self._fields  # each sample has one
                params["fields"] = self._fields + ["monotonic_s"] * self._adds_stamp
        period_s = 1.0 / hz if hz > 0.0 else 0.0  # what is no rate is refused by the daemon
        most = max(2, int(min(max(2 * batch, keep_s * hz), _INBOX_SAMPLES)))
        super().__init__(params, (1 + batch) * period_s, most)
        self.is_newest_wanted = batch == 1 and keep_s < math.inf
        self._convert = convert
        self._newest_seq: int | None = None
        self._dropped = 0
        self._lost = 0

    def learn(self, result: Message) -> None:
        """Take the daemon's state: its names are those that it knows."""
        self.params["fields"] = [name for name in STATE_FIELDS if name in result]

    def begin(self, result: Message) -> None:
        """Take the subscription's number and the present state, which is the first sample.

        The answer holds all of the state: it has the stops, too, whatever fields are asked for.
        """
        if self.identity < 0:
            state = result["state"]
            stamp_s = state.get("monotonic_s")
            if self._fields:  # none at all mean all of them
                state = {name: state[name] for name in self._fields if name in state}
            self.inbox.append(StateSample(None, 0, stamp_s, state))
            self.identity = result["subscription"]

    def deliver(self, message: Message) -> None:
        """Take one sample, or a batch of them."""
        seq, dropped = message["seq"], message.get("dropped", 0)
        if self._newest_seq is not None and seq <= self._newest_seq:
            return
        count = len(message["rows"]) if "rows" in message else 1
        lost = self._lost + max(0, len(self.inbox) + count - (self.inbox.maxlen or 0))
        self.inbox.extend(self._samples(message, dropped + lost))
        self._newest_seq, self._dropped, self._lost = seq, dropped, lost

    def _samples(self, message: Message, dropped: int) -> list[StateSample]:
        """Unpack a notification; where rows are missing in between, only the last has a `seq`."""
        seq = message["seq"]
        if "rows" not in message:
            return [StateSample(seq, dropped, message.get("monotonic_s"), message["state"])]
        states = [dict(zip(message["fields"], row, strict=True)) for row in message["rows"]]
        stamps = [state["monotonic_s"] for state in states]
        if self._adds_stamp:
            for state in states:
                del state["monotonic_s"]
        numbers: list[int | None] = list(range(seq - len(states) + 1, seq + 1))
        if message.get("dropped", 0) != self._dropped:
            numbers[:-1] = [None] * (len(states) - 1)
        one_by_one = zip(numbers, stamps, states, strict=True)
        return [StateSample(count, dropped, at_s, state) for count, at_s, state in one_by_one]

    def take(self) -> _Item | None:
        """Take the oldest sample, converted; raises what `convert` does."""
        sample: StateSample | None = self.inbox.popleft()
        if sample is None:
            return None
        self.dropped = sample.dropped
        return self._convert(sample)


def whole_state(sample: StateSample) -> GripperState:
    """Return the state in a sample of all fields; raises `ProtocolError`."""
    return GripperState.from_wire(sample.state)


def some_fields(sample: StateSample) -> dict[str, Any]:
    """Return the fields of a sample."""
    return sample.state


def ended(feed: Feed[Any], voice: Voice | None) -> ConnectError:
    """Return the error for who begins to iterate over a subscription that has ended."""
    begin = (voice or in_python)(feed.method, None, None)
    return ConnectError(
        f"no {feed.what} comes any more: the block of this subscription has ended, or it was"
        " closed",
        reason="not_connected",
        data={"hint": f"begin a new one: {begin}"} if begin else {},
    )


def anew(error: ConnectError, method: str, voice: Voice | None) -> None:
    """Have the error of a connection's end say that a new one needs a new subscription."""
    begin = (voice or in_python)(method, None, None)
    if error.hint is not None and begin is not None:
        error.data["hint"] = f"{error.hint}; after that, begin again: {begin}"


class FeedSource(Protocol):
    """What a subscription needs of its connection."""

    timeout_s: float

    @property
    def closed(self) -> bool:
        """True if the connection has ended."""

    def wait_for(self, feed: Feed[Any], timeout_s: float) -> None:
        """Wait until the feed's inbox holds something."""

    def unsubscribe(self, feed: Feed[Any]) -> None:
        """End the subscription of this feed."""


@shortened
class Subscription(Generic[_Item]):
    """Iterate to get each item as it comes; close it when done.

    A subscription that is no longer referenced ends when its next item comes.
    """

    def __init__(self, source: FeedSource, feed: Feed[_Item]) -> None:
        self._source = source
        self._feed = feed
        self._closed = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._feed!r}{', closed' if self._closed else ''}>"

    def __iter__(self) -> Subscription[_Item]:
        """Begin to iterate; raises `ConnectError` once it has ended: nothing would come."""
        if self._closed:
            raise ended(self._feed, self._feed.voice)
        return self

    def __next__(self) -> _Item:
        """Wait for the next item; raises `ConnectError` when the daemon is gone or silent."""
        if self._closed:
            raise StopIteration
        try:
            self._source.wait_for(self._feed, self._source.timeout_s + self._feed.silence_s)
        except ConnectError as error:
            if self._source.closed:
                anew(error, self._feed.method, self._feed.voice)
            raise
        item = self._feed.take()
        if item is None:
            raise StopIteration
        return item

    @property
    def dropped(self) -> int:
        """How many items this reader has missed up to the newest that it got.

        It was too slow, or the daemon had no time to send them (`health` has its late ticks).
        """
        return self._feed.dropped

    def close(self) -> None:
        """End the subscription, also for a thread that waits for an item. Again does nothing."""
        if not self._closed:
            self._closed = True
            self._feed.end()
            self._source.unsubscribe(self._feed)

    def __enter__(self) -> Subscription[_Item]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@shortened
class EventSubscription(Subscription[Event]):
    """A subscription to events: what happens from its begin on."""

    def __init__(self, source: FeedSource, feed: EventFeed) -> None:
        super().__init__(source, feed)
        self._events = feed

    @property
    def recent(self) -> tuple[Event, ...]:
        """The last events before the begin, the oldest first: 32, and of each kind the last 4."""
        return self._events.recent

    def __enter__(self) -> EventSubscription:
        return self
