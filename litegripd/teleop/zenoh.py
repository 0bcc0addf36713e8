"""The zenoh ends of a link: point to point, with all discovery off.

The leader listens, the follower connects to it and to nobody else. A leader's session is opened
once and kept: rebuilding it for every teleoperation leaves its port bound and matches unreliably (5
of 12 restarts, in the field).
"""

import json
import threading
from collections.abc import Sequence
from typing import Any

import zenoh

from litegripd.model.teleop import LinkOptions
from litegripd.teleop.udp import Deliver
from litegripd.teleop.wire import MAX_PAYLOAD_BYTES

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
                self._session.close()  # type: ignore[no-untyped-call]
                self._session = None
            config = _config(file)
            self._is_protected = _is_protected(config, leads=True)
            _listen(config, [f"{_protocol(config)}/0.0.0.0:{options.port}"])
            self._session = zenoh.open(config)
            self._made_for = (options.port, file)
        return ZenohLeader(self._session, options, deliver, is_protected=self._is_protected)


class ZenohLeader:
    """Publishes at once, and drops what the network does not take."""

    failure = None

    def __init__(
        self, session: zenoh.Session, options: LinkOptions, deliver: Deliver, *, is_protected: bool
    ) -> None:
        self.is_protected = is_protected
        self._publisher = _publisher(session, options.topic)
        self._in_use = threading.Lock()  # zenoh undeclares nothing that is in use
        self._forces = None
        if options.reflects:
            # Called from zenoh's thread: a subscriber whose thread waits cannot be undeclared, and
            # the session stays.
            self._forces = session.declare_subscriber(
                options.force_topic, lambda sample: _deliver(sample, deliver)
            )

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

    def close(self) -> None:
        """Stop publishing; the session stays."""
        with self._in_use:
            self._publisher.undeclare()  # type: ignore[no-untyped-call]
        if self._forces is not None:
            self._forces.undeclare()  # type: ignore[no-untyped-call]


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
        self._deliver = deliver
        self._subscriber = self._session.declare_subscriber(
            options.topic, zenoh.handlers.RingChannel(_QUEUED_AT_MOST)
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def publish(self, _payload: bytes) -> None:
        """Do nothing: a follower only listens, and replies."""

    def reply(self, payload: bytes, _to: str) -> None:
        """Send one frame to the leader; there is no other connection."""
        with self._in_use:
            if self._forces is not None:
                self._forces.put(payload)

    def close(self) -> None:
        """Disconnect, which also ends the listening."""
        with self._in_use:
            self._forces = None
            self._session.close()  # type: ignore[no-untyped-call]
        self._thread.join(_END_WITHIN_S)

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
    """Return zenoh's configuration: the file's, but without any discovery."""
    config: zenoh.Config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("connect/endpoints", "[]")
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
