"""A bus that is read in the control thread: SocketCAN, python-can's virtual bus, the simulator."""

import errno
import logging
from collections.abc import Sequence

import can

from litegripd.io.bus import MAX_FRAMES_PER_TICK, BusCounters, BusSettings
from litegripd.io.messages import describe, open_bus, to_frame, to_message
from litegripd.model.frame import CanFrame

_log = logging.getLogger(__name__)

_REOPEN_FIRST_S = 0.5
_REOPEN_AT_MOST_S = 5.0
_GONE = (errno.ENODEV, errno.ENXIO, errno.EBADF)
_TRANSIENT = (errno.ENOBUFS, errno.EAGAIN)
_BUS_ERRORS = (can.CanError, OSError, ValueError)


class DirectBus:
    """Sends and reads by python-can without waiting, and opens the bus again when it is lost."""

    def __init__(self, settings: BusSettings) -> None:
        self.counters = BusCounters()
        self.error: str | None = "not opened yet"
        self._settings = settings
        self._bus: can.BusABC | None = None
        self._reopen_at_s = 0.0
        self._reopen_after_s = _REOPEN_FIRST_S

    @property
    def is_up(self) -> bool:
        """Whether the last thing that was tried worked."""
        return self.error is None

    def receive(self, now_s: float) -> list[CanFrame]:
        """Return the frames that wait, at most `MAX_FRAMES_PER_TICK`."""
        bus = self._bus or self._open(now_s)
        frames: list[CanFrame] = []
        if bus is None:
            return frames
        try:
            for _ in range(MAX_FRAMES_PER_TICK):
                message = bus.recv(0)
                if message is None:
                    break
                frame = to_frame(message)
                if frame is None:
                    self.counters.ignored += 1
                    continue
                self.counters.count(frame)
                frames.append(frame)
        except _BUS_ERRORS as error:
            self._failed(error, now_s)
        if frames:
            self.counters.received += len(frames)
            self._works()
        return frames

    def send(self, frames: Sequence[CanFrame], now_s: float) -> None:
        """Send `frames`; those that cannot be sent are counted and forgotten."""
        for frame in frames:
            if self._bus is None:
                self.counters.send_failures += 1
                continue
            try:
                self._bus.send(to_message(frame))
            except _BUS_ERRORS as error:
                self.counters.send_failures += 1
                self._failed(error, now_s)
            else:
                self.counters.sent += 1
                self.counters.count(frame)

    def close(self) -> None:
        """Close the adapter; an adapter that is gone already does not matter any more."""
        if self._bus is not None:
            try:
                self._bus.shutdown()
            except _BUS_ERRORS as error:
                _log.debug("closing the bus: %s", describe(error))
            self._bus = None

    def _open(self, now_s: float) -> can.BusABC | None:
        if now_s < self._reopen_at_s:
            return None
        try:
            self._bus = open_bus(self._settings)
        except (*_BUS_ERRORS, ImportError, TypeError) as error:
            self._down(f"cannot be opened: {describe(error)}")
            self._reopen_at_s = now_s + self._reopen_after_s
            self._reopen_after_s = min(2 * self._reopen_after_s, _REOPEN_AT_MOST_S)
            return None
        if self.error != "not opened yet":
            self.counters.reopened += 1
        self._reopen_after_s = _REOPEN_FIRST_S
        self._works()
        return self._bus

    def _failed(self, error: Exception, now_s: float) -> None:
        """Note what was raised; close the bus, to open it again, where nothing else helps."""
        self.counters.errors += 1
        code = getattr(error, "error_code", None)
        if code in _TRANSIENT or "buffer full" in str(error):
            return
        self._down(describe(error))
        if code in _GONE or isinstance(error, ValueError):
            self.close()
            self._reopen_at_s = now_s + self._reopen_after_s

    def _down(self, reason: str) -> None:
        if self.error != reason:
            _log.error("CAN bus %s: %s", self._settings.channel, reason)
        self.error = reason

    def _works(self) -> None:
        if self.error is not None:
            _log.info("CAN bus %s is up", self._settings.channel)
            self.error = None
