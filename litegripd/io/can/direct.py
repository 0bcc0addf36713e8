"""A bus that is read in the control thread: SocketCAN, python-can's virtual bus, the simulator."""

import logging
from collections.abc import Sequence

import can

from litegripd.io.can.bus import (
    MAX_FRAMES_PER_TICK,
    BusCounters,
    BusSettings,
    condition_of,
    describe,
    not_opened,
    open_bus,
    to_frame,
    to_message,
    told_by,
)
from litegripd.model.motor import NOT_OPENED, UP, BusCondition, CanFrame

_log = logging.getLogger(__name__)

_REOPEN_FIRST_S = 0.5
_REOPEN_AT_MOST_S = 5.0
_FULL_AT_MOST_S = 1.0  # a full transmit queue is transient unless it lasts
_BUS_ERRORS = (can.CanError, OSError, ValueError)


class DirectBus:
    """Sends and reads by python-can without waiting, and opens the bus again when it is lost."""

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
        """Close the adapter; an adapter that is gone already does not matter any more."""
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
        """Go on with our own socket."""

    def leave(self) -> None:
        """Close our socket."""
        self.close()

    def _read(self, bus: can.BusABC, frames: list[CanFrame]) -> None:
        """Append what waits to `frames`; what was read before an error is not lost."""
        for _ in range(MAX_FRAMES_PER_TICK):
            message = bus.recv(0)
            if message is None:
                return
            if message.is_error_frame:
                self._take_error_frame(message)
                continue
            frame = to_frame(message)
            if frame is None:
                self.counters.ignored += 1
                continue
            self.counters.count(frame)
            frames.append(frame)
            self._works()  # here, so that a bus-off that is told behind it counts

    def _take_error_frame(self, message: can.Message) -> None:
        """Note a bus-off, and its end; most error frames only tell what the controller mended."""
        self.counters.error_frames += 1
        state = told_by(message)
        if state == "bus_off":
            self.counters.errors += 1
            self._sending_failed = False  # a frame that can be sent again proves nothing any more
            self.condition = BusCondition("bus_off", "the controller has left the bus")
        elif state == "up":
            self._works()

    def _open(self, now_s: float) -> None:
        if now_s < self._reopen_at_s:
            return
        try:
            self._bus = open_bus(self._settings)
        except Exception as error:  # noqa: BLE001 - an interface may raise anything
            settings = self._settings
            self.condition = not_opened(
                error, describe(error), settings.interface, settings.channel
            )
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
        """Note what was raised; close the bus, to open it again, where nothing else helps."""
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
