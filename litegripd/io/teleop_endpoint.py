"""What the link process needs of one end of a link, and the plain UDP ones."""

import socket
import threading
from collections.abc import Callable
from typing import Protocol, TypeAlias

from litegripd.model.teleop import LinkWish
from litegripd.model.teleop_frame import FRAME_BYTES

Deliver: TypeAlias = Callable[[bytes, str], None]
"""Takes a payload and the name of its sender, from any thread."""

Refuse: TypeAlias = Callable[[], None]
"""Counts what was not to be listened to."""

_LOOK_EVERY_S = 0.2


class Endpoint(Protocol):
    """One end of a link that is open."""

    def publish(self, payload: bytes) -> None:
        """Send to whoever listens; raises when the network does not take it."""

    @property
    def matching(self) -> bool | None:
        """Whether somebody listens; None where nobody can know."""

    def close(self) -> None:
        """Send and receive nothing more."""


class UdpLeader:
    """Sends every frame as one datagram to one address; raises `OSError` for an unknown host."""

    matching = None

    def __init__(self, wish: LinkWish) -> None:
        found = socket.getaddrinfo(wish.host, wish.port, type=socket.SOCK_DGRAM)
        family, kind, protocol, _, address = found[0]
        self._address: tuple[object, ...] = address
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)

    def publish(self, payload: bytes) -> None:
        """Send one datagram; nobody has to be there."""
        try:
            self._socket.sendto(payload, self._address)
        except ConnectionRefusedError:
            return  # of an earlier one: the follower is not there yet

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()


class UdpFollower:
    """Listens at the port on all addresses, to `host` alone where one is given.

    Raises `OSError` when the port is taken or the host is unknown.
    """

    matching = None

    def __init__(self, wish: LinkWish, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._hosts: set[str] | None = None
        family = socket.AF_INET
        if wish.host is not None:
            found = socket.getaddrinfo(wish.host, None, type=socket.SOCK_DGRAM)
            family = found[0][0]
            self._hosts = {str(entry[4][0]) for entry in found if entry[0] == family}
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("", wish.port))
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_LOOK_EVERY_S)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def publish(self, _payload: bytes) -> None:
        """Say nothing: a follower only listens."""

    def close(self) -> None:
        """Stop listening, and give the port back."""
        self._ends.set()
        self._thread.join()

    def _listen(self) -> None:
        with self._socket as listening:
            while not self._ends.is_set():
                try:
                    payload, sender = listening.recvfrom(FRAME_BYTES + 1)
                except TimeoutError:
                    continue
                except ConnectionRefusedError:
                    continue
                if self._hosts is None or sender[0] in self._hosts:
                    self._deliver(payload, f"{sender[0]}:{sender[1]}")
                else:
                    self._refuse()
