"""What a follower makes of what arrives: the newest frame, how old it is, and how fast it moves.

It knows no geometry: openness in, openness out. Nothing is clamped.
"""

from litegripd.control.teleop.backlog import Backlog
from litegripd.model.teleop import Arrival
from litegripd.model.teleop_frame import TeleopFrame, decode_frame

MAX_FRAME_GAP_S = 0.05
"""Frames further apart than this tell no velocity, and no velocity outlives it (vendor's SDK)."""

_SHORTEST_INTERVAL_S = 0.0005
"""Half of what the fastest leader leaves between two frames: less is no interval to divide by."""

_SAME_CLOCK_S = 1.0
"""A frame that is older than the newest by less than this was overtaken on its way. By more, it is
of another clock: a second leader's, which is not followed while the first is heard, or that of a
leader whose clock was set back, which is followed again after the watchdog's time."""


class Intake:
    """Takes frames of one leader; `latest` is None until the first.

    `begins` counts how often frames began anew: the first one, one after a silence, and one whose
    time leaps ahead. Whoever follows has to align then.
    """

    def __init__(self, watchdog_s: float) -> None:
        self.latest: TeleopFrame | None = None
        self.begins = 0
        self.frames = 0
        self.rejected = 0
        self.out_of_order = 0
        self.other_leaders = 0
        self.late = 0
        self._watchdog_s = watchdog_s
        self._arrived_s = 0.0
        self._source = ""
        self._rate_1_s = 0.0
        self._rate_at_s = 0.0
        self._backlog = Backlog(watchdog_s)

    def take(self, arrival: Arrival) -> None:
        """Take what has come, or count why not."""
        frame, latest = decode_frame(arrival.payload), self.latest
        if frame is None:
            self.rejected += 1
            return
        offset_s, is_same = arrival.at_s - frame.timestamp_s, arrival.source == self._source
        is_old = latest is not None and is_same and self._backlog.holds(offset_s, arrival.at_s)
        if latest is None or self.is_stale(arrival.at_s):
            if is_old:
                self.late += 1  # of before the silence, or of a clock that was set back just now
            else:
                self._begin(frame, arrival)
            return
        later_s = frame.timestamp_s - latest.timestamp_s
        if not is_same or later_s <= -_SAME_CLOCK_S:
            self.other_leaders += 1
        elif later_s < 0.0:
            self.out_of_order += 1
        elif later_s > _SAME_CLOCK_S + arrival.at_s - self._arrived_s:
            self._begin(frame, arrival)
        elif later_s == 0.0 and frame.openness == latest.openness:
            self._arrived_s = arrival.at_s  # a leader that stands still, and has no clock
            self._backlog.accept(offset_s, arrival.at_s)
            self.frames += 1
        else:
            self._accept(frame, arrival, self._rate(frame, latest, later_s, arrival.at_s))

    @property
    def source(self) -> str:
        """Who sent the newest frame, as the transport names it."""
        return self._source

    def is_stale(self, now_s: float) -> bool:
        """Whether no frame has come for as long as the watchdog waits, by our own clock."""
        return self.latest is not None and now_s - self._arrived_s >= self._watchdog_s

    def age_s(self, now_s: float) -> float | None:
        """Return how long ago the newest frame came."""
        return None if self.latest is None else max(now_s - self._arrived_s, 0.0)

    def rate_1_s(self, now_s: float) -> float:
        """Return how fast the openness changes; it lasts until the next frame, but not long."""
        return self._rate_1_s if now_s - self._rate_at_s <= MAX_FRAME_GAP_S else 0.0

    def _begin(self, frame: TeleopFrame, arrival: Arrival) -> None:
        self.begins += 1
        self._backlog.begin(arrival.at_s - frame.timestamp_s, arrival.at_s)
        self._accept(frame, arrival, 0.0)

    def _accept(self, frame: TeleopFrame, arrival: Arrival, rate_1_s: float) -> None:
        self.latest, self._source = frame, arrival.source
        self._arrived_s = self._rate_at_s = arrival.at_s
        self._rate_1_s = rate_1_s
        self._backlog.accept(arrival.at_s - frame.timestamp_s, arrival.at_s)
        self.frames += 1

    def _rate(self, frame: TeleopFrame, latest: TeleopFrame, later_s: float, at_s: float) -> float:
        """Difference two frames, by the sender's clock: the network's jitter is not in that.

        A sender without a clock gives the same time in every frame; then ours must do.
        """
        apart_s = at_s - self._arrived_s
        interval_s = apart_s if later_s == 0.0 else later_s
        if apart_s > MAX_FRAME_GAP_S or not _SHORTEST_INTERVAL_S <= interval_s <= MAX_FRAME_GAP_S:
            return 0.0
        return (frame.openness - latest.openness) / interval_s
