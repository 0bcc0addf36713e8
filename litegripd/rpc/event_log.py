"""Events on their way to the log: a bounded number per tick, and what is too many is told as one.

Only the log loses any: the wire has its own way.
"""

from collections import deque

from litegripd.model.events import Event

EVENTS_PER_TICK = 4  # a log line costs about 50 µs
_EVENTS_KEPT = 512
_REFUSALS_KEPT = 64


class EventLog:
    """Keeps events until a tick has the time to log them."""

    def __init__(self) -> None:
        self._events: deque[Event] = deque()
        self._left_out = 0

    def note(self, event: Event) -> None:
        """Keep an event; refusals never crowd out what happened to the gripper."""
        if len(self._events) < (_REFUSALS_KEPT if event.kind == "refused" else _EVENTS_KEPT):
            self._events.append(event)
        else:
            self._left_out += 1

    def take(self) -> list[Event]:
        """Return what has happened, the oldest first, so much at once as a tick can log."""
        taken = [self._events.popleft() for _ in range(min(EVENTS_PER_TICK, len(self._events)))]
        if self._left_out and not self._events:
            text = f"{self._left_out} events are left out of the log: too many came at once"
            taken.append(Event("refused", text, {"left_out": self._left_out}))
            self._left_out = 0
        return taken
