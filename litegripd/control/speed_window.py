"""The speed of the jaws over a short window, from measured positions alone.

The motor's own speed is filtered by it, and may be noisy; positions are exact to 0.4 mrad.
"""

from collections import deque

WINDOW_S = 0.010
"""Long enough to resolve 0.04 rad/s (3 mm/s) from the codes of a frame's position, short enough to
notice within two periods of 5 ms that the jaws have stopped or run away."""


class SpeedWindow:
    """Keeps the positions of the last `window_s` and a little more."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s * 0.999
        self._samples: deque[tuple[float, float]] = deque()

    def add(self, at_s: float, position_rad: float) -> float | None:
        """Take a measurement; return the mean speed (rad/s), None before the window is full."""
        samples = self._samples
        samples.append((at_s, position_rad))
        while len(samples) > 2 and at_s - samples[1][0] >= self._window_s:
            samples.popleft()
        elapsed_s = at_s - samples[0][0]
        if elapsed_s < self._window_s:
            return None
        return (position_rad - samples[0][1]) / elapsed_s

    @property
    def began_rad(self) -> float:
        """The oldest position in the window."""
        return self._samples[0][1]

    def clear(self) -> None:
        """Forget what was measured: what comes next does not continue it."""
        self._samples.clear()
