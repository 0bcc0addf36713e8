"""What a leader makes of its followers' force frames: who presses now, and how hard.

A force is felt only as the answer to a recent position: its echo must be a time at which this
leader published, by the leader's own clock, no longer ago than `MOST_ROUND_TRIP_S`. So frames for
another leader, frames of before and frames over a slow network are none, whatever their senders'
clocks say.
"""

from dataclasses import dataclass

from litegripd.model.force_frame import decode_force
from litegripd.model.teleop import Arrival

MOST_ROUND_TRIP_S = 0.2
"""What is older is no longer what the hand feels now; it is the watchdog's time of a follower."""
MOST_FOLLOWERS = 8


@dataclass(frozen=True, slots=True)
class _Heard:
    force_n: float
    sent_s: float
    echo_s: float


class ForceIntake:
    """Keeps the newest force of each of up to `MOST_FOLLOWERS` followers.

    `rejected` counts what was no frame, `out_of_order` frames that were older than one before,
    `late` those whose echo is not of this leader's latest positions, and those of one follower too
    many.
    """

    def __init__(self) -> None:
        self.rejected = 0
        self.out_of_order = 0
        self.late = 0
        self.round_trip_s: float | None = None
        """From a measurement of the leader to the force that answers it, of the newest frame."""
        self._heard: dict[int, _Heard] = {}

    def take(self, arrival: Arrival, now_s: float) -> None:
        """Take what has come, or count why not."""
        frame = decode_force(arrival.payload)
        if frame is None:
            self.rejected += 1
            return
        self._forget_old(now_s)
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
        """Return how many followers tell their force now."""
        return sum(_is_recent(heard.echo_s, now_s) for heard in self._heard.values())

    def force_n(self, now_s: float) -> float:
        """Return the force of that follower which presses hardest now; 0 where none is heard."""
        forces = [h.force_n for h in self._heard.values() if _is_recent(h.echo_s, now_s)]
        return max(forces, key=abs, default=0.0)

    def _forget_old(self, now_s: float) -> None:
        for sender, heard in list(self._heard.items()):
            if not _is_recent(heard.echo_s, now_s):
                del self._heard[sender]


def _is_recent(echo_s: float, now_s: float) -> bool:
    """Whether a position of this time is recent; one of the future is of another clock."""
    return 0.0 <= now_s - echo_s <= MOST_ROUND_TRIP_S
