"""Somebody else who commands our motor: noticed, told, and a reason to refuse motions.

Two programs that interleave frames on one motor fight over it, and neither can know what the
jaws do. Nothing can keep the other from sending; it can only be told of.
"""

from litegripd.model.errors import Refusal
from litegripd.model.events import Event

QUIET_AFTER_S = 2.0
"""Without a frame of theirs for so long, they count as gone."""

TOLD_EVERY_S = 10.0


class SecondMaster:
    """Keeps when a command frame that is not ours was last seen, and how many there were."""

    def __init__(self, *, is_tolerated: bool = False) -> None:
        self.is_tolerated = is_tolerated
        self.count = 0
        self.is_active = False
        self._seen_s = 0.0
        self._told_s = 0.0

    def step(self, now_s: float, count: int) -> Event | None:
        """Take the number of frames so far; return what is to be told: begin, go on, and end."""
        if count != self.count:
            self.count, self._seen_s = count, now_s
            if self.is_active and now_s - self._told_s < TOLD_EVERY_S:
                return None
            self.is_active, self._told_s = True, now_s
            return Event("second_master", self._text(), {"frames": count, "active": True})
        if self.is_active and now_s - self._seen_s >= QUIET_AFTER_S:
            self.is_active = False
            text = f"the other sender is quiet again, after {count} command frames"
            return Event("second_master", text, {"frames": count, "active": False})
        return None

    def refusal(self) -> Refusal | None:
        """Say why no motion may run, if so."""
        if self.is_tolerated or not self.is_active:
            return None
        return Refusal("second_master", self._text(), {"frames": self.count})

    def _text(self) -> str:
        return (
            f"another program commands the motor on the same bus ({self.count} frames so far):"
            " find and end it (a script with the vendor's SDK, cansend of can-utils, a second"
            " adapter), for one motor has one owner"
        )
