"""How often a loop really runs, over the last second or so."""

_WINDOW_S = 1.0


class LoopRate:
    """Counts the ticks of whole windows; before the first is over, those so far."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._ticks = 0
        self._last_hz: float | None = None
        self._latest_s = 0.0

    def tick(self, now_s: float) -> None:
        """Count one."""
        self._latest_s = now_s
        if self._began_s is None:
            self._began_s = now_s
            return
        self._ticks += 1
        elapsed_s = now_s - self._began_s
        if elapsed_s >= _WINDOW_S:
            self._last_hz = self._ticks / elapsed_s
            self._began_s, self._ticks = now_s, 0

    @property
    def hz(self) -> float:
        """The rate; 0 before the second tick."""
        if self._last_hz is not None:
            return self._last_hz
        elapsed_s = 0.0 if self._began_s is None else self._latest_s - self._began_s
        return self._ticks / elapsed_s if elapsed_s > 0.0 else 0.0
