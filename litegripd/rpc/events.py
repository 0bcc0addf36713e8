"""Events, on their way to the log and to the clients.

The log gets a bounded number per tick, and the excess is reported as one event. On the wire each
event is numbered, the latest of each kind are kept, and nothing is dropped: a client that does not
read fills its backlog, and the transport closes it.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import get_args

from litegripd.model.plain import Carried
from litegripd.model.state import Event, EventKind
from litegripd.rpc.jsonrpc import encode, notification_line
from litegripd.rpc.reports import NumberedEvent
from litegripd.rpc.sessions import Session

# The log ------------------------------------------------------------------------------------------

EVENTS_PER_TICK = 4  # a log line costs about 50 µs
_EVENTS_KEPT = 512
_REFUSALS_KEPT = 64


class EventLog:
    """Keeps events until a tick has the time to log them."""

    def __init__(self) -> None:
        self._events: deque[Event] = deque()
        self._left_out = 0

    def note(self, event: Event) -> None:
        """Keep an event; refusals never displace what happened to the gripper."""
        if len(self._events) < (_REFUSALS_KEPT if event.kind == "refused" else _EVENTS_KEPT):
            self._events.append(event)
        else:
            self._left_out += 1

    def take(self) -> list[Event]:
        """Return the events, the oldest first, as many as a tick can log."""
        taken = [self._events.popleft() for _ in range(min(EVENTS_PER_TICK, len(self._events)))]
        if self._left_out and not self._events:
            text = f"{self._left_out} events are left out of the log: too many came at once"
            taken.append(Event("refused", text, {"left_out": self._left_out}))
            self._left_out = 0
        return taken


# The wire -----------------------------------------------------------------------------------------

EVENT_KINDS: tuple[str, ...] = get_args(EventKind)
UNASKED_KINDS: tuple[str, ...] = tuple(kind for kind in EVENT_KINDS if kind != "refused")
"""The kinds of a subscription that names none: refusals are other clients' mistakes."""

KEPT_EVENTS = 32


class _Numbered:
    """One event with its number and time; encoded once, and only if a client wants it."""

    __slots__ = ("_at_s", "_encoded", "event", "sequence")

    def __init__(self, sequence: int, at_s: float, event: Event) -> None:
        self.sequence = sequence
        self.event = event
        self._at_s = at_s
        self._encoded: bytes | None = None

    def members(self) -> bytes:
        """Return the members of its JSON object, without the braces."""
        if self._encoded is None:
            event = self.event
            view: NumberedEvent = {
                "seq": self.sequence,
                "monotonic_s": self._at_s,
                "kind": event.kind,
                "message": event.message,
                "data": dict(event.data),
            }
            self._encoded = encode(view)[1:-1]
        return self._encoded


@dataclass(frozen=True, slots=True, eq=False)
class EventSubscription:
    """One subscription; the answer to it has reported the events up to `after`."""

    number: int
    session: Session
    kinds: frozenset[str]
    after: int


class EventStream:
    """Keeps the subscriptions to events, and sends new events to one client at a time.

    Events wait in rows: all clients get one row, each in its turn, while new events make the next.
    So a flood costs a tick nothing except the transport's time.
    """

    last_sequence: Carried[int] = 0
    NOT_CARRIED = ("_all", "_kept", "_next_row", "_row", "_to_tell", "_wanted")

    def __init__(self) -> None:
        self._kept: dict[str, deque[_Numbered]] = {
            kind: deque(maxlen=KEPT_EVENTS) for kind in EVENT_KINDS
        }
        self._all: dict[int, EventSubscription] = {}
        self._wanted: frozenset[str] = frozenset()
        self._next_row: list[_Numbered] = []
        self._row: tuple[_Numbered, ...] = ()
        self._to_tell: deque[EventSubscription] = deque()

    def note(self, event: Event, now_s: float) -> None:
        """Take one event of the time `now_s`."""
        self.last_sequence += 1
        numbered = _Numbered(self.last_sequence, now_s, event)
        self._kept[event.kind].append(numbered)
        if event.kind in self._wanted:
            self._next_row.append(numbered)

    def latest(self, kinds: Iterable[str]) -> bytes:
        """Return the last `KEPT_EVENTS` of these kinds as a JSON array, the oldest first."""
        kept = chain.from_iterable(self._kept[kind] for kind in kinds)
        latest = sorted(kept, key=lambda numbered: numbered.sequence)[-KEPT_EVENTS:]
        return b"[%b]" % b",".join(b"{%b}" % numbered.members() for numbered in latest)

    def add(self, number: int, session: Session, kinds: Iterable[str]) -> None:
        """Begin a subscription to future events."""
        self._all[number] = EventSubscription(number, session, frozenset(kinds), self.last_sequence)
        self._find_wanted()

    def remove(self, number: int, session: Session) -> bool:
        """End a subscription of `session`; return whether there was one."""
        sub = self._all.get(number)
        if sub is None or sub.session is not session:
            return False
        del self._all[number]
        self._find_wanted()
        return True

    def remove_all(self, session: Session) -> None:
        """End all subscriptions of a client that is gone."""
        self._all = {n: sub for n, sub in self._all.items() if sub.session is not session}
        self._find_wanted()

    @property
    def pending(self) -> bool:
        """True while events wait to be sent."""
        return bool(self._to_tell or self._next_row)

    def send_one(self) -> None:
        """Send to the client that has waited longest all that this row has for it."""
        if not self._to_tell:
            self._row, self._next_row = tuple(self._next_row), []
            self._to_tell.extend(self._all.values())
        sub = self._to_tell.popleft() if self._to_tell else None
        if sub is None or sub.number not in self._all:
            return
        for numbered in self._row:
            if numbered.event.kind in sub.kinds and numbered.sequence > sub.after:
                params = b'{"subscription":%d,%b}' % (sub.number, numbered.members())
                sub.session.write(notification_line("event", params))

    def _find_wanted(self) -> None:
        self._wanted = frozenset().union(*(sub.kinds for sub in self._all.values()))
