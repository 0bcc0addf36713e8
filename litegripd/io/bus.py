"""The CAN bus as the control thread uses it: frames out and in without ever waiting.

Two kinds share one shape, `FrameBus`: an adapter that may be read in the control thread
(`direct_bus`) and one that can block and is therefore driven by a process of its own
(`pumped_bus`). Neither raises: what goes wrong becomes its `condition`, a name and a sentence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from litegripd.model.bus import BusCondition
from litegripd.model.frame import CanFrame

DIRECT_INTERFACES = ("socketcan", "virtual", "litegrip_sim")
"""python-can interfaces whose send and recv(0) never block."""

IN_PROCESS_INTERFACES = ("virtual", "litegrip_sim")
"""Those whose bus, and what is on it, ends with the process."""

MAX_FRAMES_PER_TICK = 256
"""More than a fully loaded 1 Mbit/s bus carries in 10 ms, the longest period: nothing that is old
counts as new. What a stall has left waiting is caught up with in a few periods."""

_FRAME_OVERHEAD_BITS = 47  # start, id, control, CRC, ACK, end and interframe space
_STUFFING = 1.1  # the average share of stuff bits on top


@dataclass(frozen=True, slots=True)
class BusSettings:
    """What python-can is given: `options` are the interface's own keyword arguments."""

    interface: str
    channel: str
    bitrate: int
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(slots=True)
class BusCounters:
    """What has passed since the daemon's start; `bits` estimates the load both ways."""

    sent: int = 0
    received: int = 0
    send_failures: int = 0
    """Frames lost since the bus was open for the first time."""
    ignored: int = 0
    """Remote, extended and CAN FD frames, and lines of an adapter that are no frames."""
    error_frames: int = 0
    errors: int = 0
    reopened: int = 0
    """How often it was opened after that; attempts that fail do not count."""
    bits: float = 0.0

    def count(self, frame: CanFrame) -> None:
        """Add one frame to the load."""
        self.bits += (_FRAME_OVERHEAD_BITS + 8 * len(frame.data)) * _STUFFING


class FrameBus(Protocol):
    """A CAN bus seen from the control thread."""

    counters: BusCounters
    condition: BusCondition

    def receive(self, now_s: float) -> list[CanFrame]:
        """Return what has come since the last call; opens the bus again when that is due."""

    def send(self, frames: Sequence[CanFrame], now_s: float) -> None:
        """Hand `frames` over in this order."""

    def close(self) -> None:
        """Let go of the adapter."""

    def stand_by(self, now_s: float) -> None:
        """Open what a successor opens for itself, and drop what comes until it takes over."""

    def hand_over(self) -> tuple[tuple[int, ...], int]:
        """Return what a successor goes on with: descriptors, and the pump's pid (0: none)."""

    def take_over(self, descriptors: Sequence[int], pid: int) -> None:
        """Go on with what the predecessor has handed over."""

    def leave(self) -> None:
        """Close our end of what a successor has taken over."""
