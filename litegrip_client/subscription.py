"""An iterator over the samples of a state subscription.

The daemon decides what a slow reader misses; this module only hands on what came. It must not
read the connection by itself.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar

_Item = TypeVar("_Item")

_INBOX_SAMPLES = 256
"""More than a second at 200 Hz. Only fills while other threads read and this one does not."""


class SampleSource(Protocol):
    """What a subscription needs of its connection."""

    timeout_s: float

    def next_sample(self, subscription: "StateSubscription[Any]", timeout_s: float) -> None:
        """Wait until the subscription's inbox holds something."""

    def unsubscribe(self, identity: int) -> None:
        """End the subscription of this number."""


@dataclass(frozen=True, slots=True)
class StateSample:
    """One sample: `state` holds the subscribed fields. `seq` is None for the first one.

    `seq`, `dropped` and `monotonic_s` (CLOCK_MONOTONIC seconds) are as the daemon sent them.
    """

    seq: int | None
    dropped: int
    monotonic_s: float | None
    state: dict[str, Any]


class StateSubscription(Generic[_Item]):
    """Iterate to get the present state first and then each sample; close it when done."""

    def __init__(
        self, source: SampleSource, hz: float, convert: Callable[[StateSample], _Item]
    ) -> None:
        self.hz = hz
        self.identity = -1
        self.inbox: deque[StateSample | None] = deque(maxlen=_INBOX_SAMPLES)
        self._source = source
        self._convert = convert
        self._newest_seq: int | None = None
        self._closed = False

    def begin(self, result: dict[str, Any]) -> None:
        """Take the answer to the subscription: its number and the present state."""
        if self.identity < 0:
            state = result["state"]
            self.inbox.append(StateSample(None, 0, state.get("monotonic_s"), state))
            self.identity = result["subscription"]

    def deliver(self, sample: dict[str, Any]) -> None:
        """Take one notification; one that came before is ignored."""
        seq = sample["seq"]
        if self._newest_seq is None or seq > self._newest_seq:
            monotonic_s, state = sample.get("monotonic_s"), sample["state"]
            self.inbox.append(StateSample(seq, sample.get("dropped", 0), monotonic_s, state))
            self._newest_seq = seq

    def __iter__(self) -> "StateSubscription[_Item]":
        return self

    def __next__(self) -> _Item:
        """Wait for the next sample; raises `ConnectError` when the daemon is gone or silent."""
        if self._closed:
            raise StopIteration
        self._source.next_sample(self, self._source.timeout_s + 2.0 / self.hz)
        sample = self.inbox.popleft()
        if sample is None:
            raise StopIteration
        return self._convert(sample)

    def close(self) -> None:
        """End the subscription, also for a thread that waits for a sample. Again does nothing."""
        if not self._closed:
            self._closed = True
            self.inbox.append(None)
            self._source.unsubscribe(self.identity)

    def __enter__(self) -> "StateSubscription[_Item]":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
