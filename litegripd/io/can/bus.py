"""The CAN bus as the control thread uses it: frames out and in, without ever waiting.

Two kinds share one shape, `FrameBus`: an adapter that may be read in the control thread (here) and
one that can block and is therefore driven by a process of its own (`pumped`). Neither raises: a
failure becomes its `condition`, a name and a sentence.
"""

import errno
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import can
import can.bus

from litegripd.io.meters import RecentLateness
from litegripd.model.motor import NOT_OPENED, UP, BusCondition, BusSettings, BusState, CanFrame

MAX_FRAMES_PER_TICK = 256
"""More than a fully loaded 1 Mbit/s bus carries in 10 ms, the longest period: nothing that is old
counts as new. What a stall has left waiting is caught up with in a few periods."""

_FRAME_OVERHEAD_BITS = 47  # start, id, control, CRC, ACK, end and interframe space
_STUFFING = 1.1  # the average share of stuff bits on top


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

    @property
    def lateness(self) -> RecentLateness | None:
        """How long frames have waited for the process that drives the adapter; None without one."""

    def receive(self, now_s: float) -> list[CanFrame]:
        """Return what has come since the last call; opens the bus again when that is due."""

    def send(self, frames: Sequence[CanFrame], now_s: float) -> None:
        """Send `frames` in this order."""

    def close(self) -> None:
        """Close the adapter."""

    def stand_by(self, now_s: float) -> None:
        """Open, in a successor, its own socket; drop what comes until it takes over."""

    def hand_over(self) -> tuple[tuple[int, ...], int]:
        """Return what a successor continues with: descriptors, and the pump's pid (0: none)."""

    def take_over(self, descriptors: Sequence[int], pid: int) -> None:
        """Continue with what the predecessor has handed over."""

    def leave(self) -> None:
        """Close our end of what a successor has taken over."""


BUS_OFF = 0x40
RESTARTED = 0x100
"""Classes of an error frame, in its id (linux/can/error.h)."""

_STATES: dict[int, BusState] = {
    errno.ENETDOWN: "link_down",
    errno.ENODEV: "adapter_gone",
    errno.ENXIO: "adapter_gone",
    errno.ENOENT: "adapter_gone",
    errno.EBADF: "adapter_gone",
    errno.ENOBUFS: "bus_stalled",
    errno.EAGAIN: "bus_stalled",
}


_UNOPENED = {
    errno.ENODEV: "there is no network interface {channel}",
    errno.EAFNOSUPPORT: "this system has no CAN sockets: load them by 'sudo modprobe can_raw' (of a"
    " container, on its host); a kernel without that module cannot use SocketCAN",
}
"""What the errors of SocketCAN's socket mean."""


def code_of(error: BaseException) -> int | None:
    """Return the system's error number of an error or of its cause, None without one."""
    seen: BaseException | None = error
    while seen is not None:
        code = getattr(seen, "error_code", None) or getattr(seen, "errno", None)
        if isinstance(code, int):
            return code
        seen = seen.__cause__ or seen.__context__
    return None


def condition_of(error: BaseException, text: str, channel: str) -> BusCondition:
    """Return the bus condition for an error; without its device file the adapter is gone."""
    if "buffer full" in str(error):
        return BusCondition("bus_stalled", text)
    is_missing = channel.startswith("/") and not Path(channel).exists()
    state = _STATES.get(code_of(error) or 0, "down")
    return BusCondition("adapter_gone" if is_missing else state, text)


def explain(error: BaseException, text: str, interface: str, channel: str) -> str:
    """Return `text`, after what it means and what to do if it does not say that itself."""
    why = _UNOPENED.get(code_of(error) or 0)
    if interface != "socketcan" or why is None:
        return text
    return f"{why.format(channel=channel)} ({text})"


# python-can asks the time of day how long `recv` still has to wait: were it set back by an hour in
# the middle of a `recv(0)`, that would wait for an hour, in the control thread.
can.bus.time = time.monotonic  # type: ignore[attr-defined]


def open_bus(settings: BusSettings) -> can.BusABC:
    """Open the bus by python-can; raises whatever its interface raises.

    `ignore_config` keeps a stray python-can configuration file from changing the bus.
    """
    return can.Bus(
        interface=settings.interface,
        channel=settings.channel,
        bitrate=settings.bitrate,
        ignore_config=True,
        **settings.options,
    )


def to_message(frame: CanFrame) -> can.Message:
    """Return python-can's message for a frame."""
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)


def to_frame(message: can.Message) -> CanFrame | None:
    """Return the frame in a message, None if it is not a classic data frame.

    Error frames go first: their ids are masked to 11 bits and can equal the feedback id.
    """
    if message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd:
        return None
    return CanFrame(message.arbitration_id, bytes(message.data))


def describe(error: BaseException) -> str:
    """Return an error of python-can in one line, with its cause and the system's error number."""
    code = getattr(error, "error_code", None)
    text = str(error) or type(error).__name__
    cause = error.__cause__
    if cause is not None and str(cause) not in text:
        text += f": {describe(cause)}"
    return text if code is None else f"{text} (error {code})"


_log = logging.getLogger(__name__)

_REOPEN_FIRST_S = 0.5
_REOPEN_AT_MOST_S = 5.0
_FULL_AT_MOST_S = 1.0  # a full transmit queue is transient unless it lasts
_BUS_ERRORS = (can.CanError, OSError, ValueError)


class DirectBus:
    """Sends and reads by python-can without waiting, and opens the bus again when it is lost."""

    lateness: RecentLateness | None = None

    def __init__(self, settings: BusSettings) -> None:
        self.counters = BusCounters()
        self.condition = NOT_OPENED
        self._settings = settings
        self._bus: can.BusABC | None = None
        self._reopen_at_s = 0.0
        self._reopen_after_s = _REOPEN_FIRST_S
        self._was_open = False
        self._sending_failed = False
        self._full_since_s: float | None = None

    def receive(self, now_s: float) -> list[CanFrame]:
        """Return the frames that wait, at most `MAX_FRAMES_PER_TICK`."""
        frames: list[CanFrame] = []
        if self._bus is None:
            self._open(now_s)
        if self._bus is None:
            return frames
        try:
            self._read(self._bus, frames)
        except _BUS_ERRORS as error:
            self._failed(error, now_s)
        self.counters.received += len(frames)
        return frames

    def send(self, frames: Sequence[CanFrame], now_s: float) -> None:
        """Send `frames` in their order; from the first that fails on, they are counted and lost.

        An enable frame must never go without the zero-gain frame before it. Nothing is counted
        before the bus was open for the first time.
        """
        for number, frame in enumerate(frames):
            if self._bus is None:
                if self._was_open:
                    self.counters.send_failures += len(frames) - number
                return
            try:
                self._bus.send(to_message(frame))
            except _BUS_ERRORS as error:
                self.counters.send_failures += len(frames) - number
                self._failed(error, now_s, sending=True)
                return
            self.counters.sent += 1
            self.counters.count(frame)
            self._full_since_s = None
            # What is sent to a link that is down is refused; where the bus is off it may vanish.
            if self._sending_failed or self.condition.state == "link_down":
                self._works()

    def close(self) -> None:
        """Close the adapter, also one that is gone already."""
        if self._bus is not None:
            try:
                self._bus.shutdown()
            except _BUS_ERRORS as error:
                _log.debug("closing the bus: %s", describe(error))
            self._bus = None

    def stand_by(self, now_s: float) -> None:
        """Open a socket of our own, and drop what comes until we take over."""
        self.receive(now_s)

    def hand_over(self) -> tuple[tuple[int, ...], int]:
        """Return nothing: a successor has opened its own socket."""
        return (), 0

    def take_over(self, _descriptors: Sequence[int], _pid: int) -> None:
        """Continue with our own socket."""

    def leave(self) -> None:
        """Close our socket."""
        self.close()

    def _read(self, bus: can.BusABC, frames: list[CanFrame]) -> None:
        """Append what waits to `frames`; what was read before an error is not lost."""
        for _ in range(MAX_FRAMES_PER_TICK):
            message = bus.recv(0)
            if message is None:
                return
            if message.is_error_frame:  # most report only corrected errors
                self.counters.error_frames += 1
                if message.arbitration_id & RESTARTED:
                    self._works()
                elif message.arbitration_id & BUS_OFF:
                    self.counters.errors += 1
                    self._sending_failed = False  # a frame that can be sent again proves nothing
                    text = "the controller has left the bus"
                    self.condition = BusCondition("bus_off", text)
                continue
            frame = to_frame(message)
            if frame is None:
                self.counters.ignored += 1
                continue
            self.counters.count(frame)
            frames.append(frame)
            self._works()  # here, so that a bus-off that is reported after it counts

    def _open(self, now_s: float) -> None:
        if now_s < self._reopen_at_s:
            return
        try:
            self._bus = open_bus(self._settings)
        except Exception as error:  # noqa: BLE001 - an interface may raise anything
            settings = self._settings
            why = explain(error, describe(error), settings.interface, settings.channel)
            self.condition = condition_of(error, f"cannot be opened: {why}", settings.channel)
            self._reopen_at_s = now_s + self._reopen_after_s
            self._reopen_after_s = min(2 * self._reopen_after_s, _REOPEN_AT_MOST_S)
            return
        if self._was_open:
            self.counters.reopened += 1
        self._was_open = True
        self._reopen_after_s = _REOPEN_FIRST_S
        self._full_since_s = None
        self._works()

    def _failed(self, error: Exception, now_s: float, *, sending: bool = False) -> None:
        """Note an error; close the bus, to open it again, if nothing else helps."""
        self.counters.errors += 1
        condition = condition_of(error, describe(error), self._settings.channel)
        if condition.state == "bus_stalled":
            if self.condition.state == "bus_off":
                return  # the adapter sends nothing, and so its queue fills up
            if self._full_since_s is None:
                self._full_since_s = now_s
            if now_s - self._full_since_s < _FULL_AT_MOST_S:
                return
            text = "no frame can be sent, since nobody on the bus acknowledges any"
            condition = BusCondition("bus_stalled", text)
        self.condition = condition
        self._sending_failed = sending
        if condition.state == "adapter_gone" or isinstance(error, ValueError):
            self.close()
            self._reopen_at_s = now_s + self._reopen_after_s

    def _works(self) -> None:
        self._sending_failed = False
        self.condition = UP
