"""The line between a daemon and its successor.

Packets are JSON with descriptors beside them. A large value travels as a file in memory, by its
descriptor. Only `wait` waits.
"""

import json
import os
import select
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from litegripd.io.helper.child import CHILD_FD, MAX_PACKET_BYTES, receive_descriptors

_MAX_DESCRIPTORS = 8
_FILE_NAME = "litegripd handover"


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet from the other end: kind, members, and descriptors, which this end now owns."""

    kind: str
    body: Mapping[str, Any]
    descriptors: Sequence[int] = ()


class Link:
    """One end of the line; it does not block. `has_ended` is True once the other end is gone."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        self.has_ended = False
        self._socket = connected

    @classmethod
    def pair(cls) -> "tuple[Link, socket.socket]":
        """Return a new line: the daemon's end, and the socket that the successor inherits."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(ours), theirs

    @classmethod
    def inherited(cls) -> "Link":
        """Return the successor's end. Raises `OSError` if this process has inherited none."""
        os.set_inheritable(CHILD_FD, False)
        return cls(socket.socket(fileno=CHILD_FD))

    def fileno(self) -> int:
        """Return the descriptor; it is readable when a packet has come, or the end."""
        return self._socket.fileno()

    def send(self, kind: str, descriptors: Sequence[int] = (), **body: object) -> None:
        """Send a packet, as a whole or not at all; raises `OSError` if that is not possible."""
        packet = json.dumps([kind, body]).encode()
        socket.send_fds(self._socket, [packet], descriptors)

    def receive(self) -> Packet | None:
        """Return the next packet, or None if there is none."""
        try:
            packet, descriptors = receive_descriptors(
                self._socket, MAX_PACKET_BYTES, _MAX_DESCRIPTORS
            )
        except BlockingIOError:
            return None
        if not packet:
            self.has_ended = True
            return None
        kind, body = json.loads(packet)
        return Packet(kind, body, descriptors)

    def wait(self, within_s: float) -> Packet | None:
        """Return the next packet, or None at the end of the line or of the time."""
        select.select((self._socket,), (), (), max(within_s, 0.0))
        return self.receive()

    def is_left(self) -> bool:
        """Return whether the other end is gone; packets from it may still be unread."""
        poll = select.poll()
        poll.register(self._socket, 0)
        return bool(poll.poll(0))

    def close(self) -> None:
        """Close this end."""
        self._socket.close()


def write_document(plain: Any) -> int:
    """Return the descriptor of a new file in memory that holds `plain` as JSON."""
    descriptor = os.memfd_create(_FILE_NAME, os.MFD_CLOEXEC)
    left = json.dumps(plain).encode()
    while left:
        left = left[os.write(descriptor, left) :]
    return descriptor


def read_document(descriptor: int) -> Any:
    """Return the value that `write_document` has written, and close the descriptor."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    with open(descriptor, "rb") as file:
        return json.loads(file.read())
