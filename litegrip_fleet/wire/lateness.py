"""How old a request is that came over the network, by the clock of the gripper's machine.

No other machine's clock is believed, and none has to be right: a portal learns from each answer
what the gateway's CLOCK_MONOTONIC was at some moment of a round trip.
"""

from collections import deque

MOTION_COUNTS_S = 0.5
"""A request that a stop makes void is refused when it is older: what a network gives back after a
cut must move nothing."""

SET_POINT_COUNTS_S = 0.2

STOP_WITHIN_S = 2.0
"""A stop that is not answered by then is reported as not confirmed."""

_BEST_OF = 8
_ROUNDING_S = 1e-6


class RemoteClock:
    """The gateway's clock as a portal reckons it, from the quickest of the last round trips.

    The error is at most half of it, while the clocks keep step. A trip that contradicts the earlier
    ones ends their use: a machine has slept or was started again, or the clocks have drifted since
    the last session.
    """

    def __init__(self) -> None:
        self._trips: deque[tuple[float, float]] = deque(maxlen=_BEST_OF)

    def note(self, sent_s: float, received_s: float, remote_s: float) -> None:
        """Learn from an answer: sent and received by the own clock, answered by the other's."""
        trip_s, offset_s = received_s - sent_s, remote_s - (sent_s + received_s) / 2
        if self._trips:
            best_s, known_s = min(self._trips)
            if abs(offset_s - known_s) > (trip_s + best_s) / 2 + _ROUNDING_S:
                self._trips.clear()
        self._trips.append((trip_s, offset_s))

    def at(self, own_s: float) -> float | None:
        """Return the other clock's time at a time of the own; None before the first answer."""
        return own_s + min(self._trips)[1] if self._trips else None


def late_by(at_s: float | None, now_s: float, counts_s: float) -> float | None:
    """Return how old a request is, if that is too old; None if it still counts.

    One without a time, or from the future, is as old as can be: neither says anything.
    """
    if at_s is None or at_s - now_s > counts_s:
        return float("inf")
    age_s = now_s - at_s
    return age_s if age_s > counts_s else None


def is_over(at_s: float | None, now_s: float, cleared_s: float | None) -> bool:
    """Return True for a stop that was reported as not confirmed, and is older than a clearing.

    Nobody expects it any more. One that may still be waited for counts, whenever somebody cleared.
    """
    if at_s is None or cleared_s is None:
        return False
    return at_s < cleared_s and now_s - at_s > STOP_WITHIN_S
