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


def notify(text: str) -> bool:
    """Send lines such as READY=1; tell whether they left. Never waits, raises nothing."""
    return _send(text.encode(), ())


def barrier(within_s: float, meanwhile: Callable[[], None]) -> bool:
    """Wait until the manager has taken in all that was sent before; False if it has not in time.

    It closes the descriptor that it gets, which we see (systemd 246; others never do). `meanwhile`
    is called every few milliseconds.
    """
    ends_s = time.monotonic() + within_s
    ours, theirs = os.pipe()
    try:
        sent = _send(_BARRIER, (theirs,))
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


def _send(message: bytes, descriptors: tuple[int, ...]) -> bool:
    path = os.environ.get("NOTIFY_SOCKET", "")
    if path[:1] not in ("/", "@"):
        return False
    address = "\0" + path[1:] if path[0] == "@" else path
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        try:
            sender.connect(address)  # before Python 3.12 `send_fds` heeds no address
            socket.send_fds(sender, [message], descriptors)
        except OSError:
            return False
    return True
