"""The software stop: latched, raised by anybody, lowered only by clearing it."""

from litegripd.model.errors import Refusal
from litegripd.model.jobs import STOP_LEVELS, Owner, Stop, StopLevel


class StopLatch:
    """Keeps the latched stop and counts the stops in `generation`.

    A request tells the generation that its sender knew; one from before the latest stop never
    runs and clears nothing, though it lay unread in the kernel when the stop came. `repeats` counts
    the stops that raised nothing since the first one that is latched.
    """

    def __init__(self) -> None:
        self.latched: Stop | None = None
        self.generation = 0
        self.repeats = 0
        self._latest_s = float("-inf")

    def raise_to(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> Stop:
        """Latch a stop; one no stronger than is latched already changes nothing but the counts."""
        self.generation += 1
        self._latest_s = now_s
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

    def refusal_of_sent(self, generation: int | None, sent_s: float | None) -> Refusal | None:
        """Say whether a request was sent before the latest stop, by either mark, and so is void."""
        if generation is not None and generation < self.generation:
            told = f"knew of {generation} stops, there have been {self.generation}"
        elif sent_s is not None and sent_s < self._latest_s:
            told = f"was sent {self._latest_s - sent_s:.3f} s before the latest stop"
        else:
            return None
        return Refusal(
            "sent_before_stop",
            f"the request {told}: a stop has come since, so it is not carried out; look at the"
            " state and, when it is safe, send it again",
            {"stop_generation": self.generation},
        )
