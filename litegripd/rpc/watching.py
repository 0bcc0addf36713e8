"""The methods that subscribe: to the state, in samples or batches, and to events."""

from collections import Counter
from collections.abc import Mapping, Sequence

from litegripd.model.errors import Refusal
from litegripd.rpc.answers import SubscriptionNumber
from litegripd.rpc.calls import Answer, Call, Function
from litegripd.rpc.events import UNASKED_KINDS
from litegripd.rpc.reports import Reporter
from litegripd.rpc.subscriptions import Subscriptions

DEFAULT_SAMPLE_HZ = 20.0


class Watching:
    """Functions that begin and end subscriptions of the connection that asks."""

    def __init__(self, subscriptions: Subscriptions, reporter: Reporter) -> None:
        self._subscriptions = subscriptions
        self._reporter = reporter

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "state.subscribe": self._subscribe_to_state,
            "state.unsubscribe": self._unsubscribe_from_state,
            "events.subscribe": self._subscribe_to_events,
            "events.unsubscribe": self._unsubscribe_from_events,
        }

    def _subscribe_to_state(self, call: Call) -> Answer:
        hz = float(call.params.get("hz", DEFAULT_SAMPLE_HZ))
        names, batch = call.params.get("fields", ()), call.params.get("batch", 1)
        refusal = self._refusal_of_rate(hz) or _refusal_of_fields(names, batch)
        if refusal is not None:
            return refusal
        number = self._subscriptions.add_samples(call.session, hz, names, batch, call.now_s)
        if isinstance(number, Refusal):
            return number
        return b'{"subscription":%d,"state":%b}' % (number, self._reporter.state_line())

    def _refusal_of_rate(self, hz: float) -> Refusal | None:
        limit_hz = self._reporter.rate_hz
        if hz <= limit_hz:
            return None
        text = f"hz is {hz:g}, it must be at most the control rate, {limit_hz:g}"
        data = {"parameter": "hz", "requested": hz, "limit": limit_hz}
        return Refusal("invalid_params", f"state.subscribe: {text}", data)

    def _unsubscribe_from_state(self, call: Call) -> Answer:
        number = call.params["subscription"]
        found = self._subscriptions.remove_samples(number, call.session)
        return _ended(number) if found else _no_subscription(number, "the state")

    def _subscribe_to_events(self, call: Call) -> Answer:
        kinds = frozenset(call.params.get("kinds", UNASKED_KINDS))
        if not kinds:
            text = "events.subscribe: kinds is empty; name some, or leave it out"
            return Refusal("invalid_params", text, {"parameter": "kinds"})
        number = self._subscriptions.add_events(call.session, kinds)
        if isinstance(number, Refusal):
            return number
        latest, state = self._subscriptions.events.latest(kinds), self._reporter.state_line()
        return b'{"subscription":%d,"state":%b,"events":%b}' % (number, state, latest)

    def _unsubscribe_from_events(self, call: Call) -> Answer:
        number = call.params["subscription"]
        found = self._subscriptions.remove_events(number, call.session)
        return _ended(number) if found else _no_subscription(number, "events")


def _refusal_of_fields(names: Sequence[str], batch: int) -> Refusal | None:
    twice = next((name for name, times in Counter(names).items() if times > 1), None)
    if twice is not None:
        text = f"fields has {twice} twice; name each field once"
    elif batch > 1 and not names:
        text = "a batch needs fields: its rows have the values in their order, without names"
    else:
        return None
    return Refusal("invalid_params", f"state.subscribe: {text}", {"parameter": "fields"})


def _ended(number: int) -> SubscriptionNumber:
    return {"subscription": number}


def _no_subscription(number: int, what: str) -> Refusal:
    text = f"this connection has no subscription {number} to {what}"
    return Refusal("invalid_params", text, {"parameter": "subscription"})
