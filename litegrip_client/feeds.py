"""What subscriptions bring, and what events are. Values and inboxes, no I/O.

The samples of the state have a module of their own.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from litegrip_client.calls import Message
from litegrip_client.errors import CommandError, ConnectError
from litegrip_client.router import Key, unsubscribing
from litegrip_client.voices import Voice, in_python

_Item = TypeVar("_Item")

_INBOX_EVENTS = 4096
"""Hours of events: a reader with so many unread has stopped reading."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in the gripper: `message` describes it for a person.

    `kind` and `data` describe it for a program. `seq` counts all events since the daemon's start,
    so that a gap shows kinds that were not subscribed; `monotonic_s` is CLOCK_MONOTONIC seconds.
    """

    seq: int
    monotonic_s: float
    kind: str
    message: str
    data: Mapping[str, Any]

    @classmethod
    def from_wire(cls, data: Mapping[str, Any], voice: Voice = in_python) -> Event:
        """Read the wire's form, in the words of a voice; raises `KeyError` for what it lacks."""
        return cls(
            seq=data["seq"],
            monotonic_s=data["monotonic_s"],
            kind=data["kind"],
            message=voice(data["message"], None, None),
            data=data.get("data") or {},
        )


class Feed(Generic[_Item]):
    """The inbox of one subscription, and how to ask for it.

    `identity` is the daemon's number for it, -1 before it has one. `silence_s` is the longest
    time that may pass between two items. `what` is the name of an item, and
    `voice` the connection's.
    """

    notification: str
    method: str
    what: str

    voice: Voice | None = None

    def __init__(self, params: dict[str, Any], silence_s: float, most_items: int | None) -> None:
        self.params = params
        self.silence_s = silence_s
        self.identity = -1
        self.inbox: deque[Any] = deque(maxlen=most_items)

    @property
    def key(self) -> Key:
        """The name under which its notifications come."""
        return self.notification, self.identity

    def ending(self) -> tuple[str, dict[str, Any]]:
        """Return the method and the parameters that end it."""
        return unsubscribing(*self.key)

    def begin(self, result: Message) -> None:
        """Take the answer to the subscription; again does nothing."""
        raise NotImplementedError

    def deliver(self, message: Message) -> None:
        """Take one notification; one that came before is ignored."""
        raise NotImplementedError

    def take(self) -> _Item | None:
        """Take the oldest item out of the inbox, which has one; None says that it was the last."""
        raise NotImplementedError

    def end(self) -> None:
        """Let nothing come any more."""
        self.inbox.append(None)


class EventFeed(Feed[Event]):
    """All events of some `kinds`; `recent` are those from before, the oldest first.

    A reader that lets thousands of them wait gets an error in place of the rest.
    """

    notification = "event"
    method = "events.subscribe"
    what = "event"

    def __init__(self, kinds: Sequence[str] | None) -> None:
        """Raise `CommandError` for what cannot be kinds."""
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
    """Return a list of names; raises `CommandError` for a text, which holds but letters."""
    if isinstance(given, str):
        raise CommandError(
            f"{what} is the text {given!r:.60}, it must be a list of names",
            reason="invalid_params",
            data={"parameter": what},
        )
    return list(given)
