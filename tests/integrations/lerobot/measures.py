"""What a data set and two daemons' logs say of each other. Positions are shares of the travel."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple


class Track(NamedTuple):
    """Where jaws were, at times that rise."""

    times_s: Sequence[float]
    openness: Sequence[float]

    def at(self, time_s: float) -> float:
        """Return where they were, between two samples; raises `ValueError` outside the log."""
        index = bisect_left(self.times_s, time_s)
        if index < len(self.times_s) and self.times_s[index] == time_s:
            return self.openness[index]
        if not 0 < index < len(self.times_s):
            raise ValueError(f"{time_s:.3f} s is not in the log")
        before_s, after_s = self.times_s[index - 1], self.times_s[index]
        share = (time_s - before_s) / (after_s - before_s)
        return self.openness[index - 1] * (1.0 - share) + self.openness[index] * share

    def range(self, from_s: float, to_s: float) -> tuple[float, float]:
        """Return between which openings they were in that time."""
        inside = self.openness[bisect_left(self.times_s, from_s) : bisect_left(self.times_s, to_s)]
        inside = [*inside, self.at(from_s), self.at(to_s)]
        return min(inside), max(inside)

    def fastest_s(self, from_s: float, to_s: float, over_s: float = 0.05) -> float:
        """Return the largest change a second."""
        starts = _grid(from_s, to_s - over_s)
        return max(abs(self.at(one + over_s) - self.at(one)) for one in starts) / over_s


def _grid(from_s: float, to_s: float, step_s: float = 0.01) -> list[float]:
    return [from_s + step_s * index for index in range(int((to_s - from_s) / step_s))]


def rms(differences: Sequence[float]) -> float:
    """Return the root of the mean square."""
    return math.sqrt(sum(one * one for one in differences) / len(differences))


def delay_s(
    wanted: Sequence[tuple[float, float]],
    track: Track,
    least_s: float = 0.0,
    most_s: float = 0.3,
) -> tuple[float, float]:
    """Return how late a track is behind what was wanted when, and how far it is off then."""
    tried = [least_s + 0.002 * index for index in range(int((most_s - least_s) / 0.002))]
    off = {late: rms([track.at(t + late) - value for t, value in wanted]) for late in tried}
    best = min(off, key=lambda late: off[late])
    return best, off[best]


class Sweep(NamedTuple):
    """By how much a follower was late in one sweep of a hand, and how fast that was."""

    late_s: float
    fastest_s: float


def sweeps(
    leader: Track, follower: Track, from_s: float, to_s: float, sweep_s: float, above: float = 0.0
) -> list[Sweep]:
    """Return each whole sweep of a hand; `above`: only where the leader is opened further."""
    found, begin_s = [], from_s
    while begin_s + sweep_s <= to_s:
        wanted = [(t, leader.at(t)) for t in _grid(begin_s, begin_s + sweep_s)]
        late_s, _ = delay_s([one for one in wanted if one[1] > above], follower)
        found.append(Sweep(late_s, leader.fastest_s(begin_s, begin_s + sweep_s)))
        begin_s += sweep_s
    return found


def drifting(wanted: Sequence[tuple[float, float]], track: Track) -> tuple[float, list[float]]:
    """Return how far a replay is off, and by how much it is late in each second of it.

    LeRobot's loop makes up for nothing: each frame that is late delays all that follow. So the
    delay is looked for in each second anew.
    """
    squares, delays, begin_s, late_s = 0.0, [], wanted[0][0], 0.1
    while part := [one for one in wanted if begin_s <= one[0] < begin_s + 1.0]:
        late_s, off = delay_s(part, track, late_s - 0.1, late_s + 0.6)
        squares += off * off * len(part)
        delays.append(late_s)
        begin_s += 1.0
    return math.sqrt(squares / len(wanted)), delays
