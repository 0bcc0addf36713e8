"""The software stop: anybody latches it; it ends only when it is cleared."""

from collections.abc import Callable

from litegripd.model.errors import Refusal
from litegripd.model.jobs import STOP_LEVELS, Owner, Stop, StopLevel
from litegripd.model.plain import Carried


class StopLatch:
    """Keeps the latched stop and counts the stops in `generation`.

    A request names the generation that its sender knew. One from before the latest stop never runs
    and clears nothing, even if it lay unread in the kernel when the stop came. `repeats` counts the
    stops since the latched one that did not raise the level. `on_stop` is called with the time of
    each stop: all that has come by then came before it. `stopped_by` are the users (uid, None for
    the daemon itself) who have stopped since the present level was latched.
    """

    latched: Carried[Stop | None] = None
    generation: Carried[int] = 0
    repeats: Carried[int] = 0
    stopped_by: Carried[tuple[int | None, ...]] = ()
    _latest_s: Carried[float] = float("-inf")
    NOT_CARRIED = ("on_stop", "_latest_client", "_latest_of_others_s")  # connections end

    def __init__(self) -> None:
        self.on_stop: Callable[[float], None] = lambda _now_s: None
        self._latest_client: int | None = None
        self._latest_of_others_s = float("-inf")

    def raise_to(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> Stop:
        """Latch a stop; one that is no stronger than the latched one changes only the counts."""
        self.generation += 1
        client = None if by is None else by.client
        if client != self._latest_client:
            self._latest_client, self._latest_of_others_s = client, self._latest_s
        self._latest_s = now_s
        latched, uid = self.latched, None if by is None else by.uid
        if latched is None or STOP_LEVELS.index(level) > STOP_LEVELS.index(latched.level):
            latched = Stop(level, by, now_s, why)
            self.latched, self.stopped_by = latched, (uid,)
        else:
            self.repeats += 1
            if uid not in self.stopped_by:
                self.stopped_by += (uid,)
        self.on_stop(now_s)  # called after the latch, in case it fails
        return latched

    def may_be_cleared_by(self, uid: int, *, alone: bool) -> bool:
        """Return True if a user has stopped, and may clear it; `alone`: only if nobody else has."""
        return self.stopped_by == (uid,) if alone else uid in self.stopped_by

    def clear(self) -> int:
        """Allow requests for motions again; return the number of repeats."""
        repeats, self.repeats = self.repeats, 0
        self.latched, self.stopped_by = None, ()
        return repeats

    def refusal(self) -> Refusal | None:
        """Return why nothing may move, or None."""
        stop = self.latched
        if stop is None:
            return None
        why = "" if stop.why is None else f": {stop.why}"
        return Refusal(
            "stopped",
            f"a stop ({stop.level}) by {_stopper(stop)} is latched{why}; clear it with stop.clear"
            " first",
            {"level": stop.level, "hint": "stop.clear"},
        )

    def clearing_refusal(self, lease_held: Refusal) -> Refusal:
        """Return who may clear the stop, for a client that may not: another one has the lease."""
        owner = lease_held.data.get("owner")
        holder = f"{owner['program']} (pid {owner['pid']})" if isinstance(owner, dict) else "nobody"
        uids = [uid for uid in self.stopped_by if uid is not None]
        whose = "" if self.latched is None else f", by {_stopper(self.latched)}"
        users = "".join(f", uid {uid}, who stopped it" for uid in uids)
        return Refusal(
            lease_held.reason,
            f"the stop{whose} may be cleared by {holder}, who has the lease{users}, or an admin",
            {**lease_held.data, "may_clear_uids": uids},
        )

    def refusal_of_sent(
        self, generation: int | None, sent_s: float | None, received_s: float, client: int
    ) -> Refusal | None:
        """Return a refusal if a request is older than the latest stop, by any of its marks.

        `received_s` is when the daemon received it. What a client sent after its own stop is newer
        than that stop, even if both were received at once.
        """
        is_own = client == self._latest_client
        stopped_s = self._latest_of_others_s if is_own else self._latest_s
        if generation is not None and generation < self.generation:
            how = f"knew of {generation} stops, there have been {self.generation}"
        elif sent_s is not None and sent_s < self._latest_s:
            how = f"was sent {self._latest_s - sent_s:.3f} s before the latest stop"
        elif received_s < stopped_s:
            how = f"came {stopped_s - received_s:.3f} s before the latest stop"
        else:
            return None
        return Refusal(
            "sent_before_stop",
            f"the request {how}: a stop has come since, so it is not carried out; look at the"
            " state and, when it is safe, send it again",
            {"stop_generation": self.generation},
        )


def _stopper(stop: Stop) -> str:
    return "the daemon" if stop.by is None else f"{stop.by.program} (pid {stop.by.pid})"
