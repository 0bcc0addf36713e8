"""Signals as events of the loop, so that none interrupts a tick half-way."""

import signal
import socket
from collections.abc import Callable, Mapping
from types import FrameType


class Signals:
    """Turns signals into calls from the loop; register `fileno()` with the reactor."""

    def __init__(self, handlers: Mapping[signal.Signals, Callable[[], None]]) -> None:
        self._handlers = dict(handlers)
        self._reader, self._writer = socket.socketpair()
        self._reader.setblocking(False)
        self._writer.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        self._previous = {number: signal.signal(number, _ignore) for number in self._handlers}

    def fileno(self) -> int:
        """Return the descriptor that is readable when a signal has come."""
        return self._reader.fileno()

    def on_event(self, _mask: int) -> None:
        """Call the handlers of the signals that have come."""
        for number in self._reader.recv(64):
            handler = self._handlers.get(signal.Signals(number))
            if handler is not None:
                handler()

    def close(self) -> None:
        """Give the signals back to who had them before."""
        signal.set_wakeup_fd(-1)
        for number, previous in self._previous.items():
            signal.signal(number, previous)
        self._reader.close()
        self._writer.close()


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing: the wake-up descriptor has told the loop already."""
