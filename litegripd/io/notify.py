"""Tells the service manager how the daemon fares, where there is one that listens (sd_notify).

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
    """A socket to the manager that stays open: nothing is made anew for what is told often."""

    def __init__(self) -> None:
        path = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path[:1] == "@" else path if path[:1] == "/" else None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, text: str) -> bool:
        """Send lines such as READY=1; tell whether they left. Never waits, raises nothing."""
        if self._address is None:
            return False
        try:
            self._socket.sendto(text.encode(errors="replace"), self._address)
        except OSError:
            return False
        return True

    def barrier(self, within_s: float, meanwhile: Callable[[], None]) -> bool:
        """Wait until the manager has taken in all that was sent; False if it has not in time.

        It closes the descriptor that it gets, which we see (systemd 246; others never do).
        `meanwhile` is called every few milliseconds.
        """
        ends_s = time.monotonic() + within_s
        ours, theirs = os.pipe()
        try:
            sent = self._send_descriptor(theirs)
        finally:
            os.close(theirs)
        try:
            poll = select.poll()
            poll.register(ours, 0)
            while sent and not poll.poll(_LOOK_EVERY_MS):
                meanwhile()
                sent = time.monotonic() < ends_s
            return sent
        finally:
            os.close(ours)

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()

    def _send_descriptor(self, descriptor: int) -> bool:
        if self._address is None:
            return False
        try:
            self._socket.connect(self._address)  # before Python 3.12 `send_fds` heeds no address
            socket.send_fds(self._socket, [_BARRIER], (descriptor,))
        except OSError:
            return False
        return True


def watchdog_s(*, follows: bool = False) -> float | None:
    """Return within what time the manager wants to hear WATCHDOG=1, None where it does not.

    It names the process that it means; who follows that one in its place has inherited the name.
    """
    named = os.environ.get("WATCHDOG_PID", "")
    if named and not follows and named != str(os.getpid()):
        return None
    given = os.environ.get("WATCHDOG_USEC", "")
    return int(given) * 1e-6 if given.isascii() and given.isdigit() and int(given) else None


def one_line(text: str) -> str:
    """Make one line of a text: in a message to the manager each line is an order of its own."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
