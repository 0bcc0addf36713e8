"""Subscriptions to states and events, and what is kept of events for them."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import chain
from typing import TypedDict, get_args

from litegripd.control.snapshot import GripperState
from litegripd.model.errors import Refusal
from litegripd.model.plain import Carried
from litegripd.model.sentence import with_terms
from litegripd.model.state import Event, EventKind
from litegripd.rpc.jsonrpc import encode, notification_line
from litegripd.rpc.reports import NumberedEvent, state_view
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
KEPT_OF_KIND = 4
"""So many of each kind a new subscriber gets, too: a fault that flaps hides no loss and no stop."""


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
                "data": with_terms(event.data),
            }
            self._encoded = encode(with_terms(view))[1:-1]
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
        """Return the last events of these kinds as a JSON array, the oldest first.

        They are the last `KEPT_EVENTS`, and of each kind the last `KEPT_OF_KIND`.
        """
        rows = [self._kept[kind] for kind in kinds]
        kept = sorted(chain.from_iterable(rows), key=lambda numbered: numbered.sequence)
        told = {one.sequence for row in rows for one in list(row)[-KEPT_OF_KIND:]}
        told.update(one.sequence for one in kept[-KEPT_EVENTS:])
        latest = [one.members() for one in kept if one.sequence in told]
        return b"[%b]" % b",".join(b"{%b}" % members for members in latest)

    def add(self, number: int, session: Session, kinds: Iterable[str]) -> None:
        """Begin a subscription to future events."""
        self._all[number] = EventSubscription(number, session, frozenset(kinds), self.last_sequence)
        self._find_wanted()

    def remove(self, number: int, session: Session) -> bool:
        """End a subscription of `session`; return True if there was one."""
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


MAX_BATCH = 50


class SubscriptionNumber(TypedDict):
    """The number of a subscription."""

    subscription: int


@dataclass(slots=True, eq=False)
class SampleSubscription:
    """One subscription; `next_s` keeps its rate by absolute times.

    `fields` is empty for all; `header` is their names as JSON, which identifies the choice in every
    look-up: bytes keep their hash. `rows` are what a batch of more than one has gathered.
    """

    number: int
    session: Session
    period_s: float
    fields: tuple[str, ...]
    batch: int
    next_s: float
    sequence: int = 0
    dropped: int = 0
    rows: list[bytes] = field(default_factory=list)
    header: bytes = field(init=False)

    def __post_init__(self) -> None:
        """Encode the names of the fields."""
        self.header = encode(self.fields)

    def drop(self, samples: int) -> None:
        """Count samples that are not sent."""
        self.dropped += samples
        self.session.counters.dropped += samples


class Samples:
    """Keeps the subscriptions to the state, and serves a little at a time: no tick is held up.

    A sample that is not taken before the next one is due is dropped and counted. So is a sample, or
    a whole batch, for a client that has not read what it was sent.
    """

    def __init__(self) -> None:
        self._all: dict[int, SampleSubscription] = {}
        self._due: deque[SampleSubscription] = deque()
        self._gathering: dict[bytes, list[SampleSubscription]] = {}
        self._encoded: dict[bytes, bytes] = {}
        self._encoded_state: GripperState | None = None

    def add(self, subscription: SampleSubscription) -> None:
        """Begin a subscription."""
        self._all[subscription.number] = subscription

    def remove(self, number: int, session: Session) -> bool:
        """End a subscription of `session`, with its incomplete batch, if there is one."""
        sub = self._all.get(number)
        if sub is None or sub.session is not session:
            return False
        del self._all[number]
        return True

    def remove_all(self, session: Session) -> None:
        """End all subscriptions of a client that is gone."""
        self._all = {n: sub for n, sub in self._all.items() if sub.session is not session}

    def tick(self, now_s: float) -> None:
        """Find what is due now."""
        for sub in self._due:
            sub.drop(len(sub.rows) or 1)
            sub.rows.clear()
        for sub in chain.from_iterable(self._gathering.values()):
            sub.drop(1)
        self._due.clear()
        self._gathering.clear()
        for sub in self._all.values():
            if sub.next_s <= now_s:
                sub.next_s = max(sub.next_s + sub.period_s, now_s)
                sub.sequence += 1
                if sub.batch > 1:
                    self._gathering.setdefault(sub.header, []).append(sub)
                else:
                    self._due.append(sub)

    @property
    def pending(self) -> bool:
        """True while a sample waits to be taken, or a batch to be sent."""
        return bool(self._gathering or self._due)

    def send_one(self, state: GripperState) -> None:
        """Add a row to all batches of one choice of fields, or send what has waited longest."""
        if self._gathering:
            subs = self._gathering.pop(next(iter(self._gathering)))
            row = encode(list(state_view(state, subs[0].fields).values()))
            for sub in subs:
                sub.rows.append(row)
                if len(sub.rows) == sub.batch:
                    self._due.append(sub)
            return
        sub = self._due.popleft()
        if sub.number not in self._all:
            return
        if sub.session.congested:
            sub.drop(len(sub.rows) or 1)
        elif sub.batch > 1:
            self._send_batch(sub)
        else:
            self._send_sample(sub, state)
        sub.rows.clear()

    def _send_batch(self, sub: SampleSubscription) -> None:
        params = b'{"subscription":%d,"seq":%d,"dropped":%d,"fields":%b,"rows":[%b]}' % (
            sub.number,
            sub.sequence,
            sub.dropped,
            sub.header,
            b",".join(sub.rows),
        )
        sub.session.write(notification_line("state.batch", params))

    def _send_sample(self, sub: SampleSubscription, state: GripperState) -> None:
        params = b'{"subscription":%d,"seq":%d,"dropped":%d,%b}' % (
            sub.number,
            sub.sequence,
            sub.dropped,
            self._encode(state, sub),
        )
        sub.session.write(notification_line("state.sample", params))

    def _encode(self, state: GripperState, sub: SampleSubscription) -> bytes:
        """Encode a choice of fields once per state, for all with the same choice."""
        if self._encoded_state is not state:
            self._encoded.clear()
            self._encoded_state = state
        encoded = self._encoded.get(sub.header)
        if encoded is None:
            stamp, view = encode(state.monotonic_s), encode(state_view(state, sub.fields))
            encoded = self._encoded[sub.header] = b'"monotonic_s":%b,"state":%b' % (stamp, view)
        return encoded


MAX_PER_SESSION = 8


class Subscriptions:
    """Serves one subscription at a time; events and samples take turns, so that neither starves."""

    events: Carried[EventStream]
    NOT_CARRIED = ("_events_turn", "_last", "_open", "_samples")  # subscriptions end

    def __init__(self) -> None:
        self.events = EventStream()
        self._samples = Samples()
        self._last = 0
        self._open = 0
        self._events_turn = True

    def add_samples(
        self, session: Session, hz: float, fields: Iterable[str], batch: int, first_s: float
    ) -> int | Refusal:
        """Begin a subscription to the state; its first sample is of the first tick after `first_s`.

        Return its number, or a refusal if there can be no more.
        """
        number = self._number(session)
        if isinstance(number, int):
            sub = SampleSubscription(number, session, 1.0 / hz, tuple(fields), batch, first_s)
            self._samples.add(sub)
        return number

    def add_events(self, session: Session, kinds: Iterable[str]) -> int | Refusal:
        """Begin a subscription to events; return its number, or a refusal."""
        number = self._number(session)
        if isinstance(number, int):
            self.events.add(number, session, kinds)
        return number

    def remove_samples(self, number: int, session: Session) -> bool:
        """End a subscription of `session` to the state; return True if there was one."""
        return self._count_end(session, self._samples.remove(number, session))

    def remove_events(self, number: int, session: Session) -> bool:
        """End a subscription of `session` to events; return True if there was one."""
        return self._count_end(session, self.events.remove(number, session))

    def _count_end(self, session: Session, there_was: bool) -> bool:
        self._open -= there_was
        session.subscriptions -= there_was
        return there_was

    def remove_all(self, session: Session) -> None:
        """End all subscriptions of a client that is gone."""
        if session.subscriptions:
            self._open -= session.subscriptions
            session.subscriptions = 0
            self._samples.remove_all(session)
            self.events.remove_all(session)

    def tick(self, now_s: float) -> None:
        """Find the samples that are due now."""
        self._samples.tick(now_s)

    @property
    def pending(self) -> bool:
        """True while an event or a sample waits to be sent."""
        return self._open > 0 and (self.events.pending or self._samples.pending)

    def send_one(self, state: Callable[[], GripperState]) -> None:
        """Serve the subscription that has waited longest; there must be one (`pending`)."""
        if self.events.pending and (self._events_turn or not self._samples.pending):
            self._events_turn = False
            self.events.send_one()
        else:
            self._events_turn = True
            self._samples.send_one(state())

    def _number(self, session: Session) -> int | Refusal:
        if session.subscriptions >= MAX_PER_SESSION:
            text = f"this connection has {MAX_PER_SESSION} subscriptions already: end one"
            return Refusal("too_many_requests", text, {"limit": MAX_PER_SESSION})
        session.subscriptions += 1
        self._open += 1
        self._last += 1
        return self._last
