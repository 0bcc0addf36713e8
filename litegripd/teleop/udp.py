"""What the link process needs from one end of a link, and the plain UDP ends."""

import socket
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

from litegripd.model.teleop import LinkOptions, udp_targets
from litegripd.teleop.wire import MAX_PAYLOAD_BYTES

Deliver: TypeAlias = Callable[[bytes, str], None]
"""Takes a payload and the name of its sender, from any thread."""

Refuse: TypeAlias = Callable[[], None]
"""Counts rejected payloads."""

Address: TypeAlias = tuple[Any, ...]
"""A socket's address in Python: host, port and, with IPv6, two more numbers."""

_LOOK_EVERY_S = 0.2
_MOST_LEADERS = 8


class Endpoint(Protocol):
    """One open end of a link."""

    @property
    def is_protected(self) -> bool:
        """True if only those named in the configuration can take part."""

    def publish(self, payload: bytes) -> None:
        """Send to all listeners; raises if the network does not take it."""

    def reply(self, payload: bytes, to: str) -> None:
        """Send from a follower to the leader whose frames have come; raises as `publish`."""

    @property
    def matching(self) -> bool | None:
        """True if somebody listens; None if this is unknown."""

    @property
    def failure(self) -> Exception | None:
        """What has ended the listening, or None; only reopening helps."""

    def close(self) -> None:
        """Stop sending and receiving."""


class UdpListener:
    """A thread that takes datagrams from a socket, which it owns and closes."""

    def __init__(self, own: socket.socket, take: Callable[[bytes, Address], None]) -> None:
        self.failure: OSError | None = None
        self._own = own
        self._take = take
        self._own.settimeout(_LOOK_EVERY_S)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening, and release the port."""
        self._ends.set()
        self._thread.join()

    def _listen(self) -> None:
        with self._own as listening:
            while not self._ends.is_set():
                try:
                    payload, sender = listening.recvfrom(MAX_PAYLOAD_BYTES)
                except (TimeoutError, ConnectionRefusedError):
                    continue
                except OSError as error:
                    self.failure = error
                    return
                self._take(payload, sender)


class UdpLeader:
    """Sends every frame as one datagram to each follower; raises `OSError` for an unknown host.

    With reflection it takes what those hosts send back to its sockets, and nothing else.
    """

    matching = None
    is_protected = False

    def __init__(self, options: LinkOptions, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._listeners: list[UdpListener] = []
        found = [
            socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            for host, port in udp_targets(options)
        ]
        self._hosts = {str(entry[4][0]) for entry in found}
        families = {entry[0] for entry in found}
        self._sockets = {family: socket.socket(family, socket.SOCK_DGRAM) for family in families}
        self._targets: list[tuple[socket.socket, Address]] = [
            (self._sockets[entry[0]], entry[4]) for entry in found
        ]
        if options.reflects:
            for own in self._sockets.values():
                own.bind(("", 0))
            self._listeners = [UdpListener(own, self._hear) for own in self._sockets.values()]

    @property
    def failure(self) -> Exception | None:
        """What has ended a listener, or None."""
        return next((listener.failure for listener in self._listeners if listener.failure), None)

    def publish(self, payload: bytes) -> None:
        """Send one datagram to each; nobody has to be there, and an error delays no other one."""
        errors = [_sent(own, payload, address) for own, address in self._targets]
        failed = next((error for error in errors if error is not None), None)
        if failed is not None:
            raise failed

    def reply(self, _payload: bytes, _to: str) -> None:
        """Do nothing: a leader publishes."""

    def close(self) -> None:
        """Close the sockets."""
        for listener in self._listeners:
            listener.close()
        for own in self._sockets.values():
            own.close()

    def _hear(self, payload: bytes, sender: Address) -> None:
        if sender[0] in self._hosts:
            self._deliver(payload, name_of(sender))
        else:
            self._refuse()


class UdpFollower:
    """Listens at the port on all addresses, or that of `bind`, or only to `host` if it is given.

    Raises `OSError` if the port is taken, the host is unknown or the address is none of here.
    """

    matching = None
    is_protected = False

    def __init__(self, options: LinkOptions, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._leaders: OrderedDict[str, Address] = OrderedDict()
        self._hosts: set[str] | None = None
        family, address = socket.AF_INET, ""
        if options.bind is not None:
            own = socket.getaddrinfo(options.bind, options.port, type=socket.SOCK_DGRAM)[0]
            family, address = own[0], str(own[4][0])
        if options.host is not None:
            found = socket.getaddrinfo(options.host, None, type=socket.SOCK_DGRAM)
            family = found[0][0] if options.bind is None else family
            self._hosts = {str(entry[4][0]) for entry in found if entry[0] == family}
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind((address, options.port))
        except OSError:
            self._socket.close()
            raise
        self._listener = UdpListener(self._socket, self._hear)

    @property
    def failure(self) -> Exception | None:
        """What has ended the listener, or None."""
        return self._listener.failure

    def publish(self, _payload: bytes) -> None:
        """Do nothing: a follower only listens, and replies."""

    def reply(self, payload: bytes, to: str) -> None:
        """Send one datagram to the leader's address; nobody has to be there any more."""
        address = self._leaders.get(to)
        if address is None:
            return
        failed = _sent(self._socket, payload, address)
        if failed is not None:
            raise failed

    def close(self) -> None:
        """Stop listening, and release the port."""
        self._listener.close()

    def _hear(self, payload: bytes, sender: Address) -> None:
        if self._hosts is not None and sender[0] not in self._hosts:
            self._refuse()
            return
        name = name_of(sender)
        if name not in self._leaders:
            if len(self._leaders) >= _MOST_LEADERS:
                self._leaders.popitem(last=False)
            self._leaders[name] = sender
        self._deliver(payload, name)


def name_of(sender: Address) -> str:
    """Return a sender's name, which distinguishes it from others."""
    return f"{sender[0]}:{sender[1]}"


def _sent(own: socket.socket, payload: bytes, address: Address) -> OSError | None:
    """Send a datagram; return the error, unless nobody is there (yet, or any more)."""
    try:
        own.sendto(payload, socket.MSG_DONTWAIT, address)
    except ConnectionRefusedError:
        return None
    except OSError as error:
        return error
    return None
