"""The subscriptions of all clients, to the state and to events: their numbers and their bounds."""

from collections.abc import Callable, Iterable

from litegripd.model.errors import Refusal
from litegripd.model.state import GripperState
from litegripd.rpc.event_stream import EventStream
from litegripd.rpc.samples import Samples, SampleSubscription
from litegripd.rpc.session import Session

MAX_PER_SESSION = 8


class Subscriptions:
    """Serves one subscription at a time; events and samples take turns, so that neither starves."""

    def __init__(self) -> None:
        self.events = EventStream()
        self._samples = Samples()
        self._last = 0
        self._events_turn = True

    def add_samples(
        self, session: Session, hz: float, fields: Iterable[str], batch: int, now_s: float
    ) -> int | Refusal:
        """Begin a subscription to the state; its first sample is of one period from now.

        Returns its number, or why there can be no more.
        """
        number = self._number(session)
        if isinstance(number, int):
            period_s = 1.0 / hz
            sub = SampleSubscription(
                number, session, period_s, tuple(fields), batch, now_s + period_s
            )
            self._samples.add(sub)
        return number

    def add_events(self, session: Session, kinds: Iterable[str]) -> int | Refusal:
        """Begin a subscription to events. Returns its number, or why there can be no more."""
        number = self._number(session)
        if isinstance(number, int):
            self.events.add(number, session, kinds)
        return number

    def remove_samples(self, number: int, session: Session) -> bool:
        """End a subscription of `session` to the state; tell whether there was one."""
        there_was = self._samples.remove(number, session)
        session.subscriptions -= there_was
        return there_was

    def remove_events(self, number: int, session: Session) -> bool:
        """End a subscription of `session` to events; tell whether there was one."""
        there_was = self.events.remove(number, session)
        session.subscriptions -= there_was
        return there_was

    def remove_all(self, session: Session) -> None:
        """End all subscriptions of a client that is gone."""
        if session.subscriptions:
            session.subscriptions = 0
            self._samples.remove_all(session)
            self.events.remove_all(session)

    def tick(self, now_s: float) -> None:
        """Find the samples that are due now."""
        self._samples.tick(now_s)

    @property
    def pending(self) -> bool:
        """Whether an event or a sample waits to be sent."""
        return self.events.pending or self._samples.pending

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
        self._last += 1
        return self._last
