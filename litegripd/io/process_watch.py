"""Notices that a client's process has ended although its socket is still open.

A forked child may keep the socket; the process that was asked for, and trusted, is gone all the
same. A pidfd tells, without asking again and again.
"""

import os
from collections.abc import Callable

from litegripd.io.reactor import Reactor


class ProcessWatch:
    """Calls `on_end` once, from the event loop, when process `pid` has ended.

    Raises `OSError` where the process cannot be watched: it has ended already, or is in another
    pid namespace, whose processes have no number here (pid 0).
    """

    def __init__(self, reactor: Reactor, pid: int, on_end: Callable[[], None]) -> None:
        self._reactor = reactor
        self._on_end = on_end
        self._pidfd: int | None = os.pidfd_open(pid)
        try:
            reactor.add(self._pidfd, self)
        except OSError:
            os.close(self._pidfd)
            raise

    def on_event(self, _mask: int) -> None:
        """Take note of the end."""
        self.close()
        self._on_end()

    def close(self) -> None:
        """Watch no longer."""
        if self._pidfd is not None:
            self._reactor.remove(self._pidfd)
            os.close(self._pidfd)
            self._pidfd = None
