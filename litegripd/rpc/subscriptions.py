"""Clients that want the state again and again: latest wins, and what was dropped is told."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from litegripd.model.errors import Refusal
from litegripd.model.state import GripperState
from litegripd.rpc.session import Session
from litegripd.rpc.view import state_view
from litegripd.rpc.wire import encode, notification_line

MAX_PER_SESSION = 8


@dataclass(slots=True, eq=False)
class Subscription:
    """One subscription; `next_s` keeps its rate by absolute times."""

    number: int
    session: Session
    period_s: float
    names: tuple[str, ...]
    next_s: float
    sequence: int = 0
    dropped: int = 0


class Subscriptions:
    """Keeps them all, and sends one sample at a time, so that a tick is never held up.

    A sample that could not be sent before the next one is due is dropped and counted, and so is
    one for a client that has not read what it was sent.
    """

    def __init__(self) -> None:
        self._all: dict[int, Subscription] = {}
        self._due: deque[Subscription] = deque()
        self._last = 0
        self._encoded: dict[tuple[str, ...], bytes] = {}
        self._encoded_state: GripperState | None = None

    def add(
        self, session: Session, hz: float, names: Iterable[str], now_s: float
    ) -> Subscription | Refusal:
        """Begin a subscription; its first sample comes one period from now."""
        if sum(sub.session is session for sub in self._all.values()) >= MAX_PER_SESSION:
            text = f"this connection has {MAX_PER_SESSION} subscriptions already: end one"
            return Refusal("too_many_requests", text, {"limit": MAX_PER_SESSION})
        self._last += 1
        sub = Subscription(self._last, session, 1.0 / hz, tuple(names), now_s + 1.0 / hz)
        self._all[sub.number] = sub
        return sub

    def remove(self, number: int, session: Session) -> bool:
        """End a subscription of `session`; tell whether there was one."""
        sub = self._all.get(number)
        if sub is None or sub.session is not session:
            return False
        del self._all[number]
        return True

    def remove_all(self, session: Session) -> None:
        """End all subscriptions of a client that is gone."""
        self._all = {n: sub for n, sub in self._all.items() if sub.session is not session}

    def any_of(self, session: Session) -> bool:
        """Whether `session` has a subscription."""
        return any(sub.session is session for sub in self._all.values())

    def tick(self, now_s: float) -> None:
        """Find what is due now."""
        for sub in self._due:
            sub.dropped += 1
        self._due.clear()
        for sub in self._all.values():
            if sub.next_s <= now_s:
                sub.next_s = max(sub.next_s + sub.period_s, now_s)
                sub.sequence += 1
                self._due.append(sub)

    @property
    def pending(self) -> bool:
        """Whether a sample waits to be sent."""
        return bool(self._due)

    def send_one(self, state: GripperState) -> None:
        """Send the sample that has waited longest."""
        sub = self._due.popleft()
        if sub.number not in self._all:
            return
        if sub.session.congested:
            sub.dropped += 1
            return
        head = b'{"subscription":%d,"seq":%d,"dropped":%d,"monotonic_s":%b,"state":%b}' % (
            sub.number,
            sub.sequence,
            sub.dropped,
            encode(state.monotonic_s),
            self._encode(state, sub.names),
        )
        sub.session.write(notification_line("state.sample", head))

    def _encode(self, state: GripperState, names: tuple[str, ...]) -> bytes:
        """Encode a choice of fields once per state, for all who made the same choice."""
        if self._encoded_state is not state:
            self._encoded.clear()
            self._encoded_state = state
        encoded = self._encoded.get(names)
        if encoded is None:
            view = state_view(state)
            encoded = encode({name: view[name] for name in names} if names else view)
            self._encoded[names] = encoded
        return encoded
