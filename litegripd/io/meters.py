"""Meters of durations: a histogram since the start, and one of the last minute."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from litegripd.rpc.reports import Durations

RECENT_S = 30.0
"""A statement about the present looks back for one to two windows of this length."""

_BUCKET_S = 10e-6
_BUCKETS = 1000  # 10 ms; a longer one counts in the last bucket, the worst is kept exactly


class LatenessMeter:
    """A histogram of durations in steps of 10 µs up to 10 ms, with the exact worst."""

    def __init__(self) -> None:
        self._counts = [0] * _BUCKETS
        self._total = 0
        self.worst_s = 0.0

    def add(self, duration_s: float) -> None:
        """Count one duration; a negative one counts as zero."""
        index = int(duration_s / _BUCKET_S)
        self._counts[min(max(index, 0), _BUCKETS - 1)] += 1
        self._total += 1
        self.worst_s = max(self.worst_s, duration_s)

    def percentiles_s(self, fractions: Sequence[float]) -> list[float | None]:
        """Return the upper edge of the bucket that holds each fraction (0 to 1), ascending.

        The edge never exceeds the worst value seen; None before the first value.
        """
        if not self._total:
            return [None] * len(fractions)
        edges: list[float | None] = []
        seen = 0
        index = -1
        for fraction in fractions:
            wanted = fraction * self._total
            while seen < wanted:
                index += 1
                seen += self._counts[index]
            edges.append(min((index + 1) * _BUCKET_S, self.worst_s))
        return edges

    def summary_us(self) -> Durations:
        """Return p50, p99, p99.9 and the worst in microseconds."""
        p50_s, p99_s, p99_9_s = self.percentiles_s((0.5, 0.99, 0.999))
        return {
            "p50_us": _us(p50_s),
            "p99_us": _us(p99_s),
            "p99_9_us": _us(p99_9_s),
            "worst_us": _us(self.worst_s if self._total else None),
        }


def _us(duration_s: float | None) -> float | None:
    return None if duration_s is None else round(duration_s * 1e6, 1)


class RecentLateness:
    """The durations of the last one to two windows, for a statement about the present."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._ends_s: float | None = None
        self._current = LatenessMeter()
        self._previous = LatenessMeter()

    def add(self, now_s: float, duration_s: float) -> None:
        """Count one duration."""
        if self._ends_s is None:
            self._ends_s = now_s + self._window_s
        if now_s >= self._ends_s:
            self._previous, self._current = self._current, LatenessMeter()
            self._ends_s = now_s + self._window_s
        self._current.add(duration_s)

    def worst_s(self) -> float:
        """Return the longest duration of the two windows; 0 before the first."""
        return max(self._previous.worst_s, self._current.worst_s)

    def p99_s(self) -> float | None:
        """Return the 99th percentile of the worse of the two windows; None before the first."""
        found = [
            value
            for meter in (self._previous, self._current)
            for value in meter.percentiles_s((0.99,))
            if value is not None
        ]
        return max(found, default=None)
