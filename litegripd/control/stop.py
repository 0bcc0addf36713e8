"""The software stop: latched, raised by anybody, lowered only by clearing it."""

from collections.abc import Callable

from litegripd.model.errors import Refusal
from litegripd.model.jobs import STOP_LEVELS, Owner, Stop, StopLevel


class StopLatch:
    """Keeps the latched stop and counts the stops in `generation`.

    A request tells the generation that its sender knew; one from before the latest stop never
    runs and clears nothing, though it lay unread in the kernel when the stop came. `repeats` counts
    the stops that raised nothing since the first one that is latched. `on_stop` is called with the
    time of each stop: whatever has come by then has come before it.
    """

    def __init__(self) -> None:
        self.latched: Stop | None = None
        self.generation = 0
        self.repeats = 0
        self.on_stop: Callable[[float], None] = lambda _now_s: None
        self._latest_s = float("-inf")
        self._latest_client: int | None = None
        self._latest_of_others_s = float("-inf")

    def raise_to(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> Stop:
        """Latch a stop; one no stronger than is latched already changes nothing but the counts."""
        self.generation += 1
        client = None if by is None else by.client
        if client != self._latest_client:
            self._latest_client, self._latest_of_others_s = client, self._latest_s
        self._latest_s = now_s
        self.on_stop(now_s)
        latched = self.latched
        if latched is None or STOP_LEVELS.index(level) > STOP_LEVELS.index(latched.level):
            latched = Stop(level, by, now_s, why)
            self.latched = latched
        else:
            self.repeats += 1
        return latched

    def clear(self) -> int:
        """Let motions be asked for again; return the repeats that there were."""
        repeats, self.repeats = self.repeats, 0
        self.latched = None
        return repeats

    def refusal(self) -> Refusal | None:
        """Say why nothing may move, if so."""
        stop = self.latched
        if stop is None:
            return None
        by = "the daemon" if stop.by is None else f"{stop.by.program} (pid {stop.by.pid})"
        why = "" if stop.why is None else f": {stop.why}"
        return Refusal(
            "stopped",
            f"a stop ({stop.level}) by {by} is latched{why}; clear it with stop.clear first",
            {"level": stop.level, "hint": "stop.clear"},
        )

    def refusal_of_sent(
        self, generation: int | None, sent_s: float | None, received_s: float, client: int
    ) -> Refusal | None:
        """Return a refusal if a request is older than the latest stop, by any of its marks.

        `received_s` is when the daemon received it. What a client sent behind its own stop is newer
        than that, though both were received at once.
        """
        is_own = client == self._latest_client
        stopped_s = self._latest_of_others_s if is_own else self._latest_s
        if generation is not None and generation < self.generation:
            told = f"knew of {generation} stops, there have been {self.generation}"
        elif sent_s is not None and sent_s < self._latest_s:
            told = f"was sent {self._latest_s - sent_s:.3f} s before the latest stop"
        elif received_s < stopped_s:
            told = f"came {stopped_s - received_s:.3f} s before the latest stop"
        else:
            return None
        return Refusal(
            "sent_before_stop",
            f"the request {told}: a stop has come since, so it is not carried out; look at the"
            " state and, when it is safe, send it again",
            {"stop_generation": self.generation},
        )
