"""A leader without a second gripper and without a network: it sweeps open, closed, open.

It is for benching a single follower, and its torque guard, with a rigid object between the jaws.
"""

import math
from collections.abc import Sequence

from litegripd.model.geometry import Geometry
from litegripd.model.teleop import Arrival, LinkStatus
from litegripd.model.teleop_frame import TeleopFrame, encode_frame

SWEEP_S = 6.0
"""From open to closed and back: 63 mm/s at most on a travel of 120 mm."""


class FakeLeader:
    """A link over which a synthetic leader is heard, `rate_hz` times a second."""

    status = LinkStatus("open", is_protected=True)

    def __init__(self, geometry: Geometry, rate_hz: float) -> None:
        self._geometry = geometry
        self._every_s = 1.0 / rate_hz
        self._began_s: float | None = None
        self._sent = 0

    def publish(self, _payload: bytes, _now_s: float) -> bool:
        """Nobody listens to a follower."""
        return False

    def reply(self, _payload: bytes, _to: str, _now_s: float) -> bool:
        """Tell nobody: a synthetic leader has no hand."""
        return False

    def receive(self, now_s: float) -> Sequence[Arrival]:
        """Return the frame that is due, if one is."""
        if self._began_s is None:
            self._began_s = now_s
        due = 1 + math.floor((now_s - self._began_s) / self._every_s + 1e-6)
        if due <= self._sent:
            return ()
        self._sent = due
        at_s = (due - 1) * self._every_s
        openness = 0.5 + 0.5 * math.cos(2.0 * math.pi * at_s / SWEEP_S)
        frame = TeleopFrame(openness, openness * self._geometry.travel_mm, 0.0, at_s)
        return (Arrival(encode_frame(frame), now_s),)

    def close(self) -> None:
        """There is nothing to give back."""
