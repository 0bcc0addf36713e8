"""Standstills of the daemon itself: for a motor that heard nothing then, no wiring is to blame."""

RECENT_S = 1.0
"""For so long after a standstill it explains a communication loss. The motor reports one in its
first answer; where that answer is lost, the motor is looked for first."""

_TICKS_BESIDE = 2
"""A command may leave one tick before the standstill, and one after it."""


class Standstill:
    """Notices a tick so late that the motor's own watchdog ran out before it."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._ticked_s: float | None = None
        self._ended_s: float | None = None
        self._lasted_s = 0.0

    def tick(self, now_s: float, watchdog_s: float) -> None:
        """Note the time of a tick; `watchdog_s` is what the motor waits for commands, 0 if off."""
        before_s, self._ticked_s = self._ticked_s, now_s
        if before_s is None or watchdog_s <= 0.0:
            return
        lasted_s = now_s - before_s
        if lasted_s > max(watchdog_s - _TICKS_BESIDE * self._period_s, self._period_s):
            self._ended_s, self._lasted_s = now_s, lasted_s

    def before(self, now_s: float) -> float | None:
        """Return for how long the daemon stood still shortly before `now_s`; None if it did not."""
        if self._ended_s is None or now_s - self._ended_s > RECENT_S:
            return None
        return self._lasted_s
