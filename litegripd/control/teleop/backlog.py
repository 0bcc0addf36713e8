"""What lay in the network during a silence, told from what is fresh: old motion is no target.

A cut cable keeps frames: TCP delivers them when it is mended, seconds old and all at once. Two
machines share no clock, but the time of arrival less the sender's own time is constant, but for the
network's delay: what has much more of it than before the silence is old. Unless it stays like
that: then the sender's clock is another one now.
"""

_WINDOW_S = 10.0
"""So long a least delay counts at least; clocks drift by less than a millisecond meanwhile."""

_CATCHING_UP_S = 0.02
"""A network that gives back what it has kept is less late from frame to frame."""


class Backlog:
    """Judges a sender's frames by their offset: arrival less the sender's own time, in seconds."""

    def __init__(self, late_s: float) -> None:
        """Take as late what is so much later than before; as long as that it may stay so."""
        self._late_s = late_s
        self._least_s: tuple[float, float] | None = None
        self._window_began_s = 0.0
        self._late_since_s: float | None = None
        self._late_least_s = 0.0

    def begin(self, offset_s: float, at_s: float) -> None:
        """Forget what was before: a frame of another sender, or of another clock."""
        self._least_s = offset_s, offset_s
        self._window_began_s, self._late_since_s = at_s, None

    def accept(self, offset_s: float, at_s: float) -> None:
        """Learn from a frame that is followed."""
        before_s, least_s = (offset_s, offset_s) if self._least_s is None else self._least_s
        if at_s - self._window_began_s >= _WINDOW_S:
            before_s, least_s, self._window_began_s = least_s, offset_s, at_s
        self._least_s = before_s, min(least_s, offset_s)

    def holds(self, offset_s: float, at_s: float) -> bool:
        """Whether a frame is old, so that a fresh one can be waited for; every frame is shown."""
        if self._least_s is None or offset_s - min(self._least_s) <= self._late_s:
            self._late_since_s = None
            return False
        catches_up = offset_s < self._late_least_s - _CATCHING_UP_S
        if self._late_since_s is None or catches_up:
            self._late_since_s, self._late_least_s = at_s, offset_s
        return at_s - self._late_since_s < self._late_s * 0.999
