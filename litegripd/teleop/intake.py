"""What arrives from the other side: positions of a leader, forces of followers.

`Intake` gives a follower the newest frame, its age and its speed. It knows no geometry: openness
in, openness out. Nothing is clamped.

`Backlog` separates fresh frames from those that the network kept during a silence: old motion is no
target. A cut cable keeps frames: when it is repaired, TCP delivers them together, seconds old. Two
machines share no clock, but the time of arrival minus the sender's own time is constant, except for
the network's delay. A frame whose difference is much larger than before the silence is old. If the
difference stays that large, the sender's clock has changed.

`ForceIntake` gives a leader the present force of its followers. A force counts only as the answer
to a recent position: its echo must be a time at which this leader published, by the leader's own
clock, at most `MOST_ROUND_TRIP_S` ago. This excludes frames for another leader, earlier frames and
frames over a slow network, whatever their senders' clocks say.
"""

from dataclasses import dataclass

from litegripd.model.teleop import Arrival, TeleopFrame, decode_force, decode_frame

_WINDOW_S = 10.0
"""The least delay is kept for at least this time; clocks drift by less than 1 ms meanwhile."""

_CATCHING_UP_S = 0.02
"""A network that delivers kept frames gets less late from frame to frame."""


class Backlog:
    """Judges a sender's frames by their offset: arrival less the sender's own time, in seconds."""

    def __init__(self, late_s: float) -> None:
        """Store how much later than before is late, and how long that may last."""
        self._late_s = late_s
        self._least_s: tuple[float, float] | None = None
        self._window_began_s = 0.0
        self._late_since_s: float | None = None
        self._late_least_s = 0.0

    def begin(self, offset_s: float, at_s: float) -> None:
        """Forget the past: the next frame is of another sender, or of another clock."""
        self._least_s = offset_s, offset_s
        self._window_began_s, self._late_since_s = at_s, None

    def accept(self, offset_s: float, at_s: float) -> None:
        """Learn from a frame that is followed."""
        before_s, least_s = (offset_s, offset_s) if self._least_s is None else self._least_s
        if at_s - self._window_began_s >= _WINDOW_S:
            before_s, least_s, self._window_began_s = least_s, offset_s, at_s
        self._least_s = before_s, min(least_s, offset_s)

    def holds(self, offset_s: float, at_s: float) -> bool:
        """Return True if a frame is old and a fresh one can be expected; pass it every frame."""
        if self._least_s is None or offset_s - min(self._least_s) <= self._late_s:
            self._late_since_s = None
            return False
        catches_up = offset_s < self._late_least_s - _CATCHING_UP_S
        if self._late_since_s is None or catches_up:
            self._late_since_s, self._late_least_s = at_s, offset_s
        return at_s - self._late_since_s < self._late_s * 0.999


MAX_FRAME_GAP_S = 0.05
"""Frames further apart give no velocity, and no velocity lasts longer (vendor's SDK)."""

_SHORTEST_INTERVAL_S = 0.0005
"""Half the interval of the fastest leader: a shorter one is no interval to divide by."""

_SAME_CLOCK_S = 1.0
"""A frame older than the newest by less than this was overtaken on its way. A larger difference
means another clock: that of a second leader, which is not followed while the first is heard, or one
that was set back, which is followed again after the watchdog's time."""


class Intake:
    """Takes frames of one leader; `latest` is None until the first.

    `begins` counts the starts: the first frame, one after a silence, and one whose time leaps
    ahead, which counts once the next one confirms that time. A follower then has to align.
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
        self.source = ""
        """The sender of the newest frame, as the transport names it."""
        self._rate_1_s = 0.0
        self._rate_at_s = 0.0
        self._backlog = Backlog(watchdog_s)
        self._leapt: tuple[TeleopFrame, Arrival] | None = None

    def take(self, arrival: Arrival) -> None:
        """Take a payload that has arrived, or count why it is rejected."""
        frame, latest = decode_frame(arrival.payload), self.latest
        if frame is None:
            self.rejected += 1
            return
        offset_s, is_same = arrival.at_s - frame.timestamp_s, arrival.source == self.source
        is_old = latest is not None and is_same and self._backlog.holds(offset_s, arrival.at_s)
        if latest is None or self.is_stale(arrival.at_s):
            if is_old:
                self.late += 1  # from before the silence, or of a clock that was set back just now
            else:
                self._begin(frame, arrival)
            return
        later_s = frame.timestamp_s - latest.timestamp_s
        if not is_same or later_s <= -_SAME_CLOCK_S:
            self.other_leaders += 1
        elif later_s < 0.0:
            self.out_of_order += 1
        elif later_s > _SAME_CLOCK_S + arrival.at_s - self._arrived_s:
            self._leap(frame, arrival)
        elif later_s == 0.0 and frame.openness == latest.openness:
            self._arrived_s = arrival.at_s  # a leader that stands still, without a clock
            self._backlog.accept(offset_s, arrival.at_s)
            self.frames += 1
        else:
            self._accept(frame, arrival, self._rate(frame, latest, later_s, arrival.at_s))

    def is_stale(self, now_s: float) -> bool:
        """Return True if no frame has come within the watchdog's time, by our own clock."""
        return self.latest is not None and now_s - self._arrived_s >= self._watchdog_s

    def age_s(self, now_s: float) -> float | None:
        """Return the age of the newest frame, by its arrival."""
        return None if self.latest is None else max(now_s - self._arrived_s, 0.0)

    def rate_1_s(self, now_s: float) -> float:
        """Return how fast the openness changes; valid until the next frame, but not for long."""
        return self._rate_1_s if now_s - self._rate_at_s <= MAX_FRAME_GAP_S else 0.0

    def _leap(self, frame: TeleopFrame, arrival: Arrival) -> None:
        """Begin with a frame of another time once a second one confirms it: one may be damaged."""
        before, self._leapt = self._leapt, (frame, arrival)
        if before is None:
            return
        first, arrived = before
        later_s = frame.timestamp_s - first.timestamp_s
        if 0.0 <= later_s <= _SAME_CLOCK_S + arrival.at_s - arrived.at_s:
            self._leapt = None
            self._begin(first, arrived)
            self.take(arrival)
        else:
            self.out_of_order += 1

    def _begin(self, frame: TeleopFrame, arrival: Arrival) -> None:
        self.begins += 1
        self._backlog.begin(arrival.at_s - frame.timestamp_s, arrival.at_s)
        self._accept(frame, arrival, 0.0)

    def _accept(self, frame: TeleopFrame, arrival: Arrival, rate_1_s: float) -> None:
        if self._leapt is not None:  # nothing has confirmed it
            self._leapt = None
            self.out_of_order += 1
        self.latest, self.source = frame, arrival.source
        self._arrived_s = self._rate_at_s = arrival.at_s
        self._rate_1_s = rate_1_s
        self._backlog.accept(arrival.at_s - frame.timestamp_s, arrival.at_s)
        self.frames += 1

    def _rate(self, frame: TeleopFrame, latest: TeleopFrame, later_s: float, at_s: float) -> float:
        """Return the slope of two frames by the sender's clock, which has no network jitter.

        A sender without a clock gives the same time in every frame; then our clock is used.
        """
        apart_s = at_s - self._arrived_s
        interval_s = apart_s if later_s == 0.0 else later_s
        if apart_s > MAX_FRAME_GAP_S or not _SHORTEST_INTERVAL_S <= interval_s <= MAX_FRAME_GAP_S:
            return 0.0
        return (frame.openness - latest.openness) / interval_s


MOST_ROUND_TRIP_S = 0.2
"""An older force is no longer what the hand feels now; equal to a follower's watchdog time."""
MOST_FOLLOWERS = 8


@dataclass(frozen=True, slots=True)
class _Heard:
    force_n: float
    sent_s: float
    echo_s: float


class ForceIntake:
    """Keeps the newest force of each of up to `MOST_FOLLOWERS` followers.

    `rejected` counts what was no frame, `out_of_order` frames older than an earlier one, and `late`
    those whose echo is not of this leader's latest positions, and those of a follower too many.
    """

    def __init__(self) -> None:
        self.rejected = 0
        self.out_of_order = 0
        self.late = 0
        self.round_trip_s: float | None = None
        """Time from a measurement of the leader to the force that answers it, for the newest
        frame."""
        self._heard: dict[int, _Heard] = {}

    def take(self, arrival: Arrival, now_s: float) -> None:
        """Take a payload that has arrived, or count why it is rejected."""
        frame = decode_force(arrival.payload)
        if frame is None:
            self.rejected += 1
            return
        for sender, heard in list(self._heard.items()):
            if not _is_recent(heard.echo_s, now_s):
                del self._heard[sender]
        before = self._heard.get(frame.sender)
        is_full = before is None and len(self._heard) >= MOST_FOLLOWERS
        if is_full or not _is_recent(frame.echo_s, now_s):
            self.late += 1
        elif before is not None and frame.timestamp_s <= before.sent_s:
            self.out_of_order += 1
        else:
            self._heard[frame.sender] = _Heard(frame.force_n, frame.timestamp_s, frame.echo_s)
            self.round_trip_s = now_s - frame.echo_s

    def followers(self, now_s: float) -> int:
        """Return how many followers report their force now."""
        return sum(_is_recent(heard.echo_s, now_s) for heard in self._heard.values())

    def force_n(self, now_s: float) -> float:
        """Return the largest force that a follower reports now; 0 without followers."""
        forces = [h.force_n for h in self._heard.values() if _is_recent(h.echo_s, now_s)]
        return max(forces, key=abs, default=0.0)


def _is_recent(echo_s: float, now_s: float) -> bool:
    """Return True if a position of this time is recent; a future time is of another clock."""
    return 0.0 <= now_s - echo_s <= MOST_ROUND_TRIP_S
