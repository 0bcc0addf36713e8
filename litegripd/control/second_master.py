"""Another program that commands our motor: detected, reported, and a reason to reject motions.

Two programs that interleave frames on one motor fight over it, and neither can know what the jaws
do. Nothing can keep the other one from sending; it can only be reported. A program that writes the
motor's registers changes what every frame means, and counts the same.
"""

from litegripd.model.errors import Refusal
from litegripd.model.motor import RegisterWrite
from litegripd.model.plain import Carried
from litegripd.model.state import Event

QUIET_AFTER_S = 2.0
"""Without a frame for this time, the other program counts as gone."""

REPORT_EVERY_S = 10.0


class SecondMaster:
    """Counts the frames of others, and knows when the last one came."""

    is_active: Carried[bool] = False
    _seen_s: Carried[float] = 0.0
    _told_s: Carried[float] = 0.0
    NOT_CARRIED = ("is_tolerated", "count", "_write", "_known_write")  # the motor counts from 0

    def __init__(self, *, is_tolerated: bool = False) -> None:
        self.is_tolerated = is_tolerated
        self.count = 0
        self._write: RegisterWrite | None = None
        """The latest write while another program is active."""
        self._known_write: RegisterWrite | None = None

    def step(self, now_s: float, count: int, write: RegisterWrite | None = None) -> Event | None:
        """Take the number of frames so far, and the latest of them that wrote registers.

        Return an event to report: a begin, another write, a reminder, or the end.
        """
        is_other = write is not None and write is not self._known_write
        is_new = is_other and write != self._write
        if is_other:
            self._write = self._known_write = write
        if count != self.count:
            self.count, self._seen_s = count, now_s
            if self.is_active and not is_new and now_s - self._told_s < REPORT_EVERY_S:
                return None
            self.is_active, self._told_s = True, now_s
            return Event("second_master", self._text(), {**self._data(), "active": True})
        if self.is_active and now_s - self._seen_s >= QUIET_AFTER_S:
            self.is_active, self._write = False, None
            text = f"the other sender is quiet again, after {count} frames"
            return Event("second_master", text, {"frames": count, "active": False})
        return None

    def refusal(self) -> Refusal | None:
        """Return why no motion may run, or None."""
        if self.is_tolerated or not self.is_active:
            return None
        return Refusal("second_master", self._text(), self._data())

    def _data(self) -> dict[str, object]:
        data: dict[str, object] = {"frames": self.count}
        if self._write is not None:
            data |= {"register": self._write.name, "value": self._write.value}
        return data

    def _text(self) -> str:
        does, write = "commands the motor", self._write
        if write is not None and write.name is None:
            does = "saves the motor's registers"
        elif write is not None:
            value = "" if write.value is None else f" to {write.value:g}"
            does = f"writes the motor's register {write.name}{value}"
        return (
            f"another program {does} on the same bus ({self.count} frames so far):"
            " find and end it (the maker's tool, a script with the vendor's SDK, cansend of"
            " can-utils, a second adapter), for one motor has one owner"
        )
