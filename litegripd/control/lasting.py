"""Something that must be so without a break for a while, counted in time and not in ticks."""


class Lasting:
    """Tells when a condition has held for `duration_s` at every time at which it was asked."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s * 0.999  # ticks fall a rounding error short of their period
        self._since_s: float | None = None

    def step(self, is_so: bool, at_s: float) -> bool:
        """Take whether it is so at `at_s`; return True once it has been so for long enough."""
        if not is_so:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = at_s
        return self.has_lasted(at_s)

    def has_lasted(self, at_s: float) -> bool:
        """Return True if it has been so for long enough at `at_s`, since the last `step`."""
        return self._since_s is not None and at_s - self._since_s >= self._duration_s

    def reset(self) -> None:
        """Begin again."""
        self._since_s = None
