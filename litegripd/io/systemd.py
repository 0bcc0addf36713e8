"""Notifications to the service manager, where one listens (sd_notify).

The protocol is one datagram of lines `NAME=value` to the socket that NOTIFY_SOCKET names.
"""

import os
import select
import socket
import time
from collections.abc import Callable

_BARRIER = b"BARRIER=1"
_LOOK_EVERY_MS = 5


class Notifier:
    """A socket to the manager that stays open, for frequent notifications."""

    def __init__(self) -> None:
        path = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path[:1] == "@" else path if path[:1] == "/" else None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.is_full = False
        """True if the last notification found no room: the manager has not read the earlier
        ones."""

    def send(self, text: str) -> bool:
        """Send lines (READY=1); return whether they left. Never waits, raises nothing."""
        return self._left(lambda address: self._send_text(text, address))

    def insist(self, text: str, goes_on: Callable[[], bool]) -> bool:
        """Send lines, and retry while there is no room; return whether they left.

        `goes_on` is called every few milliseconds; when it returns False, the attempt ends.
        """
        return self._insist(lambda: self.send(text), goes_on)

    def barrier(self, within_s: float, goes_on: Callable[[], bool]) -> bool:
        """Wait until the manager has read all that was sent; False if it has not in time.

        It closes the descriptor that it gets, which we see (systemd 246; other managers never do).
        The time counts from when there was room for that. `goes_on` is as for `insist`.
        """
        ours, theirs = os.pipe()
        try:
            waits = self._insist(
                lambda: self._left(lambda address: self._send_descriptor(theirs, address)), goes_on
            )
        finally:
            os.close(theirs)
        ends_s = time.monotonic() + within_s
        try:
            poll = select.poll()
            poll.register(ours, 0)
            while waits and not poll.poll(_LOOK_EVERY_MS):
                waits = goes_on() and time.monotonic() < ends_s
            return waits
        finally:
            os.close(ours)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _insist(self, send: Callable[[], bool], goes_on: Callable[[], bool]) -> bool:
        while not send():
            if not self.is_full or not goes_on():
                return False
            select.select((), (), (), _LOOK_EVERY_MS * 1e-3)
        return True

    def _left(self, send: Callable[[str], None]) -> bool:
        self.is_full = False
        if self._address is None:
            return False
        try:
            send(self._address)
        except BlockingIOError:
            self.is_full = True
            return False
        except OSError:
            return False
        return True

    def _send_text(self, text: str, address: str) -> None:
        self._socket.sendto(text.encode(errors="replace"), address)

    def _send_descriptor(self, descriptor: int, address: str) -> None:
        self._socket.connect(address)  # before Python 3.12 `send_fds` ignores an address
        socket.send_fds(self._socket, [_BARRIER], (descriptor,))


def watchdog_s(*, follows: bool = False) -> float | None:
    """Return the time within which the manager expects WATCHDOG=1, or None.

    It names the process that it means; a successor of that one has inherited the name.
    """
    named = os.environ.get("WATCHDOG_PID", "")
    if named and not follows and named != str(os.getpid()):
        return None
    given = os.environ.get("WATCHDOG_USEC", "")
    return int(given) * 1e-6 if given.isascii() and given.isdigit() and int(given) else None


def one_line(text: str) -> str:
    """Return a text as one line: in a message to the manager each line is a command of its own."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
