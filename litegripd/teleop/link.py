"""What an action needs from a link, and the link that stays inside the process.

Nothing here waits: opening, connecting and resolving names happen elsewhere.
"""

from collections import deque
from collections.abc import Sequence
from typing import Protocol

from litegripd.model.teleop import Arrival, LinkOptions, LinkStatus, TeleopMode

_QUEUED_AT_MOST = 32


class Link(Protocol):
    """One end of a link while it is used."""

    @property
    def status(self) -> LinkStatus:
        """The present status."""

    def publish(self, payload: bytes, now_s: float) -> bool:
        """Send to all listeners, without waiting; return whether it left."""

    def reply(self, payload: bytes, to: str, now_s: float) -> bool:
        """Send from a follower to its leader, the `source` of the frames; as `publish`."""

    def receive(self, now_s: float) -> Sequence[Arrival]:
        """Return what has arrived since the last call, the oldest first."""

    def close(self) -> None:
        """Stop sending and receiving."""


class Links(Protocol):
    """Makes links."""

    def open(self, options: LinkOptions) -> Link:
        """Begin to open a link; return it at once, it becomes usable by itself."""

    def warning(self, options: LinkOptions) -> str | None:
        """Return what a person should know before such a link is used, or None."""


class InProcessLinks:
    """A bus inside the process: links leaders and followers of a topic, without a network."""

    NOT_CARRIED = ("_ends",)

    def __init__(self) -> None:
        self._ends: list[InProcessLink] = []

    def open(self, options: LinkOptions) -> "InProcessLink":
        """Open an end; the kind of link does not matter here."""
        end = InProcessLink(self, options)
        self._ends.append(end)
        return end

    def warning(self, _link_options: LinkOptions) -> str | None:
        """Return None: nobody else can listen or send."""
        return None

    def forget(self, end: "InProcessLink") -> None:
        """Remove an end from the bus."""
        self._ends = [other for other in self._ends if other is not end]

    def listeners(self, options: LinkOptions) -> "list[InProcessLink]":
        """Return the followers of a leader."""
        return self._others("slave", options)

    def leaders(self, options: LinkOptions) -> "list[InProcessLink]":
        """Return a follower's leaders that listen to forces."""
        return [end for end in self._others("master", options) if end.options.reflects]

    def _others(self, mode: TeleopMode, options: LinkOptions) -> "list[InProcessLink]":
        return [
            end
            for end in self._ends
            if end.options.mode == mode and end.options.topic == options.topic
        ]


class InProcessLink:
    """One end of the bus inside the process."""

    def __init__(self, links: InProcessLinks, options: LinkOptions) -> None:
        self.options = options
        self._links = links
        self._arrived: deque[Arrival] = deque(maxlen=_QUEUED_AT_MOST)

    @property
    def status(self) -> LinkStatus:
        """It is open from the start."""
        leads = self.options.mode == "master"
        return LinkStatus(
            "open",
            matching=bool(self._links.listeners(self.options)) if leads else None,
            is_protected=True,
        )

    def publish(self, payload: bytes, now_s: float) -> bool:
        """Put a payload into each follower's queue."""
        for listener in self._links.listeners(self.options):
            listener.deliver(Arrival(payload, now_s))
        return True

    def reply(self, payload: bytes, _to: str, now_s: float) -> bool:
        """Put a payload into the queue of each leader that listens."""
        for leader in self._links.leaders(self.options):
            leader.deliver(Arrival(payload, now_s))
        return True

    def deliver(self, arrival: Arrival) -> None:
        """Take what another end sends."""
        self._arrived.append(arrival)

    def receive(self, _now_s: float) -> Sequence[Arrival]:
        """Empty the queue."""
        arrived = tuple(self._arrived)
        self._arrived.clear()
        return arrived

    def close(self) -> None:
        """Leave the bus."""
        self._links.forget(self)
