"""What the link process needs of one end of a link, and the plain UDP ones."""

import socket
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

from litegripd.model.teleop import LinkWish, udp_targets
from litegripd.teleop.wire import MAX_PAYLOAD_BYTES

Deliver: TypeAlias = Callable[[bytes, str], None]
"""Takes a payload and the name of its sender, from any thread."""

Refuse: TypeAlias = Callable[[], None]
"""Counts what was not to be listened to."""

Address: TypeAlias = tuple[Any, ...]
"""A socket's address as Python has it: host, port and, with IPv6, two numbers more."""

_LOOK_EVERY_S = 0.2
_MOST_LEADERS = 8


class Endpoint(Protocol):
    """One end of a link that is open."""

    @property
    def is_protected(self) -> bool:
        """True if only whom the configuration names can take part."""

    def publish(self, payload: bytes) -> None:
        """Send to whoever listens; raises when the network does not take it."""

    def reply(self, payload: bytes, to: str) -> None:
        """Send from a follower to the leader that frames have come from; raises as `publish`."""

    @property
    def matching(self) -> bool | None:
        """True if somebody listens; None where nobody can know."""

    @property
    def failure(self) -> Exception | None:
        """What has ended the listening, if anything; only opening anew helps."""

    def close(self) -> None:
        """Send and receive nothing more."""


class UdpListener:
    """A thread that takes datagrams from a socket, which is its own to close."""

    def __init__(self, own: socket.socket, take: Callable[[bytes, Address], None]) -> None:
        self.failure: OSError | None = None
        self._own = own
        self._take = take
        self._own.settimeout(_LOOK_EVERY_S)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening, and give the port back."""
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

    With reflection it takes what those hosts send back to its sockets, and nobody else.
    """

    matching = None
    is_protected = False

    def __init__(self, wish: LinkWish, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._listeners: list[UdpListener] = []
        found = [
            socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            for host, port in udp_targets(wish)
        ]
        self._hosts = {str(entry[4][0]) for entry in found}
        families = {entry[0] for entry in found}
        self._sockets = {family: socket.socket(family, socket.SOCK_DGRAM) for family in families}
        self._targets: list[tuple[socket.socket, Address]] = [
            (self._sockets[entry[0]], entry[4]) for entry in found
        ]
        if wish.reflects:
            for own in self._sockets.values():
                own.bind(("", 0))
            self._listeners = [UdpListener(own, self._hear) for own in self._sockets.values()]

    @property
    def failure(self) -> Exception | None:
        """What has ended a listener, if anything."""
        return next((listener.failure for listener in self._listeners if listener.failure), None)

    def publish(self, payload: bytes) -> None:
        """Send one datagram to each; nobody has to be there, and none waits for another's error."""
        errors = [_sent(own, payload, address) for own, address in self._targets]
        failed = next((error for error in errors if error is not None), None)
        if failed is not None:
            raise failed

    def reply(self, _payload: bytes, _to: str) -> None:
        """Say nothing: a leader publishes."""

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
    """Listens at the port on all addresses, to `host` alone where one is given.

    Raises `OSError` when the port is taken or the host is unknown.
    """

    matching = None
    is_protected = False

    def __init__(self, wish: LinkWish, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._leaders: OrderedDict[str, Address] = OrderedDict()
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
        self._listener = UdpListener(self._socket, self._hear)

    @property
    def failure(self) -> Exception | None:
        """What has ended the listener, if anything."""
        return self._listener.failure

    def publish(self, _payload: bytes) -> None:
        """Say nothing: a follower only listens, and replies."""

    def reply(self, payload: bytes, to: str) -> None:
        """Send one datagram to where the leader's come from; nobody has to be there any more."""
        address = self._leaders.get(to)
        if address is None:
            return
        failed = _sent(self._socket, payload, address)
        if failed is not None:
            raise failed

    def close(self) -> None:
        """Stop listening, and give the port back."""
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
    """Name a sender, so that two are told from each other."""
    return f"{sender[0]}:{sender[1]}"


def _sent(own: socket.socket, payload: bytes, address: Address) -> OSError | None:
    """Send a datagram; return why that failed, unless nobody is there (yet, or any more)."""
    try:
        own.sendto(payload, socket.MSG_DONTWAIT, address)
    except ConnectionRefusedError:
        return None
    except OSError as error:
        return error
    return None
