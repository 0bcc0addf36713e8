"""What is served first in every tick, and between ticks as well: stops and signals.

The loop's own row is served between ticks, as far as their share of the period goes; whoever
stands in it may have to wait behind a flood of requests. What is registered here never does.
"""

import logging
import select
import time

from litegripd.io.reactor import Handler

_log = logging.getLogger(__name__)

SHARE = 0.1
"""Of a period; so much of each tick a flood of stops can take at most."""


class Urgent:
    """A row of descriptors of its own; register `fileno()` with the loop, and call `serve` first.

    The descriptors take turns: one that is always ready keeps no other waiting. A handler that
    fails is asked again: no defect makes the daemon deaf to a stop.
    """

    def __init__(self, period_s: float) -> None:
        self.errors = 0
        self._share_s = SHARE * period_s
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}

    def fileno(self) -> int:
        """Return the descriptor that is readable when any of the registered ones is."""
        return self._epoll.fileno()

    def add(self, fd: int, handler: Handler) -> None:
        """Serve `fd` whenever it can be read; raises `OSError` where the kernel refuses."""
        self._epoll.register(fd, select.EPOLLIN)
        self._handlers[fd] = handler

    def remove(self, fd: int) -> None:
        """Forget `fd`, if it is served; call it before the descriptor is closed."""
        if self._handlers.pop(fd, None) is not None:
            self._epoll.unregister(fd)

    def serve(self) -> None:
        """Serve what is ready now, without waiting, within the share of a period."""
        until_s = time.monotonic() + self._share_s
        while ready := self._epoll.poll(0, 1):  # one at a time: the kernel lets them take turns
            self._dispatch(*ready[0])
            if time.monotonic() >= until_s:
                return

    def on_event(self, _mask: int) -> None:
        """Serve between two ticks."""
        self.serve()

    def close(self) -> None:
        """Give the epoll descriptor back."""
        self._epoll.close()

    def _dispatch(self, fd: int, mask: int) -> None:
        try:
            self._handlers[fd].on_event(mask)
        except Exception:  # noqa: BLE001 - one descriptor must not end the others
            self.errors += 1
            if self.errors == 1:
                _log.exception("the handler of descriptor %d failed; it goes on being served", fd)
