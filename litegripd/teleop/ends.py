"""The ends of a link in its process: plain UDP, and zenoh without any discovery."""

import contextlib
import errno
import json
import os
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias

import zenoh

from litegripd.model.teleop import LinkOptions, Reach, udp_targets
from litegripd.teleop.link import MAX_PAYLOAD_BYTES

Deliver: TypeAlias = Callable[[bytes, str], None]
"""Takes a payload and the name of its sender, from any thread."""

Refuse: TypeAlias = Callable[[], None]
"""Counts rejected payloads."""

Address: TypeAlias = tuple[Any, ...]
"""A socket's address in Python: host, port and, with IPv6, two more numbers."""

_LOOK_EVERY_S = 0.2
_MOST_LEADERS = 8
_SILENT_AFTER_S = 3.0
"""Without a frame for so long nobody sends; without a refusal for so long nobody refuses: a system
answers at least once a second that nobody listens at a port (icmp_ratelimit)."""


_TELL_REFUSALS = {
    socket.AF_INET: (socket.IPPROTO_IP, 11),
    socket.AF_INET6: (socket.IPPROTO_IPV6, 25),
}
"""IP_RECVERR and IPV6_RECVERR of Linux, ip(7): a socket that is not connected hears of refusals,
too. A connected one would keep the own address that this machine had when it was opened."""


class Endpoint(Protocol):
    """One open end of a link."""

    @property
    def is_protected(self) -> bool:
        """True if only those named in the configuration can take part."""

    def publish(self, payload: bytes) -> None:
        """Send to all listeners; raises if the network does not take it."""

    def reply(self, payload: bytes, to: str) -> None:
        """Send from a follower to the leader whose frames have come; raises as `publish`."""

    def tell(self, payload: bytes) -> None:
        """Send from a follower to all leaders whether it is ready; raises as `publish`."""

    @property
    def matching(self) -> bool | None:
        """True if somebody listens; None if this is unknown."""

    @property
    def reach(self) -> Reach | None:
        """How far it has come to the one end that it goes to; None if it goes to none."""

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

    With reflection it takes what those hosts send back to its sockets, and nothing else. Without it
    each follower has a socket, which hears that nobody listens there.
    """

    matching = None
    is_protected = False

    def __init__(self, options: LinkOptions, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._listeners: list[UdpListener] = []
        found = [_resolved(host, port)[0] for host, port in udp_targets(options)]
        self._hosts = {str(entry[4][0]) for entry in found}
        self._refused_s: dict[Address, tuple[float, float]] = {}  # the first and the last time
        self._sockets: dict[object, socket.socket] = {}  # by family, or one for each follower
        self._targets: list[tuple[socket.socket, Address]] = []
        for family, _kind, _protocol, _name, address in found:
            whose = family if options.reflects else address
            if whose not in self._sockets:
                self._sockets[whose] = socket.socket(family, socket.SOCK_DGRAM)
            own = self._sockets[whose]
            self._targets.append((own, address))
            if not options.reflects:
                own.setsockopt(*_TELL_REFUSALS[family], 1)
        if options.reflects:
            for own in self._sockets.values():
                own.bind(("", 0))
            self._listeners = [UdpListener(own, self._hear) for own in self._sockets.values()]

    @property
    def failure(self) -> Exception | None:
        """What has ended a listener, or None."""
        return next((listener.failure for listener in self._listeners if listener.failure), None)

    @property
    def reach(self) -> Reach:
        """That it sends, and who refuses it: a datagram that is lost tells nobody."""
        since_s = time.monotonic() - _SILENT_AFTER_S
        for address, (first_s, last_s) in tuple(self._refused_s.items()):
            if last_s >= since_s:
                why = f"{name_of(address)} refuses what is sent: nobody listens at that port"
                return Reach("sending", why, first_s)
        return Reach("sending")

    def publish(self, payload: bytes) -> None:
        """Send one datagram to each; nobody has to be there, and an error delays no other one."""
        errors = [self._sent(own, payload, address) for own, address in self._targets]
        failed = next((error for error in errors if error is not None), None)
        if failed is not None:
            raise failed

    def reply(self, _payload: bytes, _to: str) -> None:
        """Do nothing: a leader publishes."""

    def tell(self, _payload: bytes) -> None:
        """Do nothing: a leader publishes."""

    def close(self) -> None:
        """Close the sockets."""
        for listener in self._listeners:
            listener.close()
        for own in self._sockets.values():
            own.close()

    def _sent(self, own: socket.socket, payload: bytes, address: Address) -> OSError | None:
        """Send a datagram; return the error. A refusal is of an earlier one: it is sent again."""
        failed = _sent(own, payload, address)
        if not isinstance(failed, ConnectionRefusedError):
            return failed
        with contextlib.suppress(OSError):  # or the queue of refusals fills up
            own.recvmsg(MAX_PAYLOAD_BYTES, 256, socket.MSG_ERRQUEUE | socket.MSG_DONTWAIT)
        now_s = time.monotonic()
        first_s, last_s = self._refused_s.get(address, (now_s, now_s))
        is_new = now_s - last_s > _SILENT_AFTER_S
        self._refused_s[address] = (now_s if is_new else first_s, now_s)
        failed = _sent(own, payload, address)
        return None if isinstance(failed, ConnectionRefusedError) else failed

    def _hear(self, payload: bytes, sender: Address) -> None:
        if sender[0] in self._hosts:
            self._deliver(payload, name_of(sender))
        else:
            self._refuse()


class UdpFollower:
    """Listens at the port on all addresses, or that of `bind`, or only to `host` if it is given.

    All addresses are those of IPv4 and IPv6: a leader may know this machine by either.
    Raises `OSError` if the port is taken, the host is unknown or the address is none of here.
    """

    matching = None
    is_protected = False

    def __init__(self, options: LinkOptions, deliver: Deliver, refuse: Refuse) -> None:
        self._deliver = deliver
        self._refuse = refuse
        self._leaders: OrderedDict[str, Address] = OrderedDict()
        self._hosts: set[str] | None = None
        self._options = options
        self._since_s = time.monotonic()  # of the last frame, or since it listens
        self._is_heard = False
        self._stranger: tuple[str, float] | None = None
        if options.host is not None:
            self._hosts = {str(entry[4][0]) for entry in _resolved(options.host, None)}
        self._socket = _bound(options.bind, options.port)
        self._listener = UdpListener(self._socket, self._hear)

    @property
    def failure(self) -> Exception | None:
        """What has ended the listener, or None."""
        return self._listener.failure

    @property
    def reach(self) -> Reach:
        """Whether frames come, and if not, for how long none has come."""
        since_s, now_s = self._since_s, time.monotonic()
        if now_s - since_s < _SILENT_AFTER_S:
            return Reach("frames" if self._is_heard else "bound")
        port, host, stranger = self._options.port, self._options.host, self._stranger
        if stranger is not None and now_s - stranger[1] < _SILENT_AFTER_S:
            name = f"frames come to UDP port {port} from {stranger[0]}, and none from {host}"
            return Reach("bound", name, since_s)
        whose = "" if host is None else f" from {host}"
        return Reach("bound", f"no frame comes to UDP port {port}{whose}", since_s)

    def publish(self, _payload: bytes) -> None:
        """Do nothing: a follower only listens, and replies."""

    def reply(self, payload: bytes, to: str) -> None:
        """Send one datagram to the leader's address; nobody has to be there any more."""
        address = self._leaders.get(to)
        if address is None:
            return
        failed = _sent(self._socket, payload, address)
        if failed is not None and not isinstance(failed, ConnectionRefusedError):
            raise failed

    def tell(self, _payload: bytes) -> None:
        """Do nothing: a datagram has no topic that tells it from a frame."""

    def close(self) -> None:
        """Stop listening, and release the port."""
        self._listener.close()

    def _hear(self, payload: bytes, sender: Address) -> None:
        host = _plain(sender[0])
        if self._hosts is not None and host not in self._hosts:
            self._stranger = (host, time.monotonic())
            self._refuse()
            return
        self._since_s, self._is_heard = time.monotonic(), True
        name = name_of(sender)
        if name not in self._leaders:
            if len(self._leaders) >= _MOST_LEADERS:
                self._leaders.popitem(last=False)
            self._leaders[name] = sender
        self._deliver(payload, name)


class UnresolvedError(OSError):
    """A name that does not resolve; the message names it."""


def _resolved(host: str, port: int | None, kind: int = socket.SOCK_DGRAM) -> list[Any]:
    """Return the addresses of a name; raises `UnresolvedError`."""
    try:
        return socket.getaddrinfo(host, port, type=kind)
    except (OSError, UnicodeError) as error:
        text = error.strerror if isinstance(error, OSError) else str(error)
        raise UnresolvedError(f"the name {host} does not resolve: {text}") from error


def _bound(host: str | None, port: int) -> socket.socket:
    """Return a socket at a port of one address, or of all that this machine has."""
    family, address = socket.AF_INET, ""
    if host is not None:
        found = _resolved(host, port)[0]
        family, address = found[0], str(found[4][0])
    elif socket.has_dualstack_ipv6():
        family = socket.AF_INET6
    own = socket.socket(family, socket.SOCK_DGRAM)
    try:
        if host is None and family == socket.AF_INET6:
            own.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        own.bind((address, port))
    except OSError:
        own.close()
        raise
    return own


def _plain(host: object) -> str:
    """Return an address of IPv4 as such, which a socket for both shows as one of IPv6."""
    return str(host).removeprefix("::ffff:")


def name_of(address: Address) -> str:
    """Return an address as people write it, with its port."""
    host, port = _plain(address[0]), address[1]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _sent(own: socket.socket, payload: bytes, address: Address) -> OSError | None:
    """Send a datagram; return the error."""
    try:
        own.sendto(payload, socket.MSG_DONTWAIT, address)
    except OSError as error:
        return error
    return None


_LOOK_AT_REACH_EVERY_S = 0.25
_TRY_FIRST_S = 1.0
_TRY_AT_MOST_S = 5.0
_CONNECT_WITHIN_S = 1.0
_PATIENCE_S = 3.0
"""zenoh connects within a second to a port that listens; after this it is no leader's."""
_ADDRESSES = 4
"""So many addresses of a name are tried; the first that takes a connection ends it."""


class Reaching:
    """Watches from a thread of its own whether a leader is reached; `close` ends it.

    zenoh retries silently. So a connection is tried with plain TCP, and closed at once, while the
    leader is not reached.
    """

    def __init__(self, host: str, port: int, is_reached: Callable[[], bool]) -> None:
        self._host, self._port = host, port
        self._where = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self._is_reached = is_reached
        self._ends = threading.Event()
        self._accepted_s: float | None = None
        self.reach = Reach("resolving")
        threading.Thread(target=self._watch, daemon=True).start()

    def close(self) -> None:
        """Stop; a name that is being resolved is not waited for."""
        self._ends.set()

    def _watch(self) -> None:
        try_at_s, after_s = time.monotonic(), _TRY_FIRST_S
        while not self._ends.is_set():
            now_s = time.monotonic()
            if self._is_reached():
                self._note(Reach("connected"))
                self._accepted_s, after_s, try_at_s = None, _TRY_FIRST_S, now_s + _TRY_FIRST_S
            elif now_s >= try_at_s:
                found = self._try()
                if not self._is_reached():
                    self._note(found)
                try_at_s = time.monotonic() + after_s
                after_s = min(2.0 * after_s, _TRY_AT_MOST_S)
            self._ends.wait(_LOOK_AT_REACH_EVERY_S)

    def _note(self, found: Reach) -> None:
        """Take what was found; a cause that lasts keeps the time of its beginning."""
        before = self.reach
        if (found.state, found.why) != (before.state, before.why):
            since_s = None if found.why is None else time.monotonic()
            self.reach = Reach(found.state, found.why, since_s)

    def _try(self) -> Reach:
        try:
            found = _resolved(self._host, self._port, socket.SOCK_STREAM)
        except UnresolvedError as error:
            return Reach("resolving", str(error))
        why: str | None = None
        for family, kind, protocol, _name, address in found[:_ADDRESSES]:
            try:
                with socket.socket(family, kind, protocol) as tried:
                    tried.settimeout(_CONNECT_WITHIN_S)
                    tried.connect(address)
            except OSError as error:
                why = why or self._refused(error)
                continue
            return self._accepted()
        self._accepted_s = None
        return Reach("connecting", why)

    def _refused(self, error: OSError) -> str:
        if isinstance(error, ConnectionRefusedError):
            return f"{self._where} has refused the connection: nobody listens at that port"
        if isinstance(error, TimeoutError) or error.errno == errno.ETIMEDOUT:
            return f"{self._where} does not answer: it is off, elsewhere, or behind a firewall"
        what = os.strerror(error.errno) if error.errno else str(error)
        return f"{self._where} is unreachable: {what}"

    def _accepted(self) -> Reach:
        now_s = time.monotonic()
        if self._accepted_s is None:
            self._accepted_s = now_s
        if now_s - self._accepted_s < _PATIENCE_S:
            return Reach("connecting")
        return Reach(
            "connecting",
            f"{self._where} takes connections, but what listens there is no leader's link, or one"
            " with other certificates",
        )


_QUEUED_AT_MOST = 16
_RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}
"""How often a follower tries to reach a missing leader."""
_LEASE_MS = 2000
"""A session without a sign of life is kept for this time: after a cut, TCP would retry ever more
rarely, and for longer than the cable was cut."""
_OPEN_WITHIN_MS = 2000
_END_WITHIN_S = 2.0
_ROOTS = ("root_ca_certificate", "root_ca_certificate_base64")
_CERTIFICATES = (
    *_ROOTS,
    "listen_certificate",
    "listen_certificate_base64",
    "connect_certificate",
    "connect_certificate_base64",
)


class ZenohLeaders:
    """Makes the leaders' ends; keeps their session while port and file stay the same."""

    def __init__(self) -> None:
        self._session: zenoh.Session | None = None
        self._made_for: tuple[int, str | None] | None = None
        self._is_protected = False

    def open(self, options: LinkOptions, file: str | None, deliver: Deliver) -> "ZenohLeader":
        """Return a publisher of the topic; raises `zenoh.ZError` if the port is taken."""
        if self._session is None or self._made_for != (options.port, file):
            if self._session is not None:
                self._session.close()
                self._session = None
            config = _config(file)
            self._is_protected = _is_protected(config, leads=True)
            every = "[::]" if socket.has_dualstack_ipv6() else "0.0.0.0"  # noqa: S104 - as asked
            _listen(config, [f"{_protocol(config)}/{every}:{options.port}"])
            self._session = zenoh.open(config)
            self._made_for = (options.port, file)
        return ZenohLeader(self._session, options, deliver, is_protected=self._is_protected)


class ZenohLeader:
    """Publishes at once, and drops what the network does not take."""

    failure = reach = None

    def __init__(
        self, session: zenoh.Session, options: LinkOptions, deliver: Deliver, *, is_protected: bool
    ) -> None:
        self.is_protected = is_protected
        self._publisher = _publisher(session, options.topic)
        self._in_use = threading.Lock()  # zenoh undeclares nothing that is in use
        # Called from zenoh's thread: a subscriber whose thread waits cannot be undeclared, and the
        # session stays.
        topics = (options.ready_topic, *([options.force_topic] if options.reflects else ()))
        self._subscribers = [
            session.declare_subscriber(topic, lambda sample: _deliver(sample, deliver))
            for topic in topics
        ]

    @property
    def matching(self) -> bool | None:
        """True if a follower listens."""
        status: Any = self._publisher.matching_status  # zenoh's stubs call it a bool
        return bool(status.matching)

    def publish(self, payload: bytes) -> None:
        """Send one frame."""
        with self._in_use:
            self._publisher.put(payload)

    def reply(self, _payload: bytes, _to: str) -> None:
        """Do nothing: a leader publishes."""

    def tell(self, _payload: bytes) -> None:
        """Do nothing: a leader publishes."""

    def close(self) -> None:
        """Stop publishing; the session stays."""
        with self._in_use:
            self._publisher.undeclare()
        for subscriber in self._subscribers:
            subscriber.undeclare()


class ZenohFollower:
    """Connects to one leader, also if it appears or returns later."""

    matching = failure = None

    def __init__(self, options: LinkOptions, file: str | None, deliver: Deliver) -> None:
        config = _config(file)
        _listen(config, [])
        host = (
            f"[{options.host}]"
            if options.host is not None and ":" in options.host
            else options.host
        )
        endpoint = f"{_protocol(config)}/{host}:{options.port}"
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/retry", json.dumps(_RETRY))
        config.insert_json5("open/return_conditions/connect_scouted", "false")
        self.is_protected = _is_protected(config, leads=False)
        self._session = zenoh.open(config)
        self._in_use = threading.Lock()
        self._forces = _publisher(self._session, options.force_topic) if options.reflects else None
        self._ready: zenoh.Publisher | None = _publisher(self._session, options.ready_topic)
        self._deliver = deliver
        self._subscriber = self._session.declare_subscriber(
            options.topic, zenoh.handlers.RingChannel(_QUEUED_AT_MOST)
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        self._reaching = Reaching(options.host or "", options.port, self._is_reached)

    @property
    def reach(self) -> Reach:
        """How far it has come to its leader."""
        return self._reaching.reach

    def publish(self, _payload: bytes) -> None:
        """Do nothing: a follower only listens, and replies."""

    def reply(self, payload: bytes, _to: str) -> None:
        """Send one frame to the leader; there is no other connection."""
        with self._in_use:
            if self._forces is not None:
                self._forces.put(payload)

    def tell(self, payload: bytes) -> None:
        """Send whether this follower is ready."""
        with self._in_use:
            if self._ready is not None:
                self._ready.put(payload)

    def close(self) -> None:
        """Disconnect, which also ends the listening."""
        self._reaching.close()
        with self._in_use:
            self._forces = self._ready = None
            self._session.close()
        self._thread.join(_END_WITHIN_S)

    def _is_reached(self) -> bool:
        try:
            return bool(self._session.info.peers_zid())
        except zenoh.ZError:  # closed
            return False

    def _listen(self) -> None:
        while True:
            try:
                sample = self._subscriber.recv()
            except zenoh.ZError:  # closed
                return
            _deliver(sample, self._deliver)


def _deliver(sample: zenoh.Sample, deliver: Deliver) -> None:
    stamp, payload = sample.timestamp, sample.payload
    source = "" if stamp is None else str(stamp.get_id())
    # A payload that is too long is no frame: counting it needs no copy.
    is_long = len(payload) >= MAX_PAYLOAD_BYTES
    deliver(bytes(MAX_PAYLOAD_BYTES) if is_long else payload.to_bytes(), source)


def _config(file: str | None) -> zenoh.Config:
    """Return zenoh's configuration: the file's, but without any discovery or shared memory."""
    config: zenoh.Config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("connect/endpoints", "[]")
    # Payloads from 3072 bytes are lost by it without a word (zenoh issue 2628).
    config.insert_json5("transport/shared_memory", '{"enabled": false, "mode": "lazy"}')
    config.insert_json5("transport/link/tx/lease", str(_LEASE_MS))
    config.insert_json5("transport/unicast/open_timeout", str(_OPEN_WITHIN_MS))
    return config


def _listen(config: zenoh.Config, endpoints: Sequence[str]) -> None:
    config.insert_json5("listen/endpoints", json.dumps(list(endpoints)))


def _protocol(config: zenoh.Config) -> str:
    """Return tls if the configuration names certificates, else tcp."""
    return "tls" if _names(config, _CERTIFICATES) else "tcp"


def _names(config: zenoh.Config, keys: Sequence[str]) -> bool:
    """Return True if TLS has one of these; asked one by one: zenoh hides `_base64` in a row."""
    return any(json.loads(config.get_json(f"transport/link/tls/{key}")) for key in keys)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """Publish at once, and drop what the network does not take."""
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME,
        express=True,
    )


def _is_protected(config: zenoh.Config, *, leads: bool) -> bool:
    """Return True if the configuration lets only those take part whom it names.

    For a leader that is TLS with certificates of both ends, an access list, or users with
    passwords. A follower chooses its leader, so it is TLS with the authority of the leader's
    certificate; its own access list does not distinguish a false leader from the right one.
    """
    is_tls = _protocol(config) == "tls"
    if not leads:
        return is_tls and _names(config, _ROOTS)
    access = json.loads(config.get_json("access_control"))
    users = json.loads(config.get_json("transport/auth/usrpwd"))
    lists = access["enabled"] and access["default_permission"] == "deny"
    return bool((is_tls and _names(config, ["enable_mtls"])) or lists or users["dictionary_file"])
