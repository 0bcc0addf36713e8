"""The zenoh ends of a link: point to point, with all discovery off.

The leader listens, the follower connects to it and to nobody else. A leader's session is opened
once and kept: one that is rebuilt for every teleoperation leaves its port bound and matches
unreliably (5 of 12 restarts, in the field).
"""

import json
import threading
from collections.abc import Sequence
from typing import Any

import zenoh

from litegripd.io.teleop_endpoint import Deliver
from litegripd.model.teleop import LinkWish
from litegripd.model.teleop_frame import FRAME_BYTES

_QUEUED_AT_MOST = 16
_RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}
"""How often a follower tries to reach a leader that is not there, or that has gone."""
_END_WITHIN_S = 2.0
_CERTIFICATES = ("root_ca_certificate", "listen_certificate", "connect_certificate")


class ZenohLeaders:
    """Makes the leaders' ends; keeps their session, for as long as port and file stay the same."""

    def __init__(self) -> None:
        self._session: zenoh.Session | None = None
        self._made_for: tuple[int, str | None] | None = None

    def open(self, wish: LinkWish, file: str | None) -> "ZenohLeader":
        """Return a publisher of the topic; raises `zenoh.ZError` when the port is taken."""
        if self._session is None or self._made_for != (wish.port, file):
            if self._session is not None:
                self._session.close()  # type: ignore[no-untyped-call]
                self._session = None
            config = _config(file)
            _listen(config, [f"{_protocol(config)}/0.0.0.0:{wish.port}"])
            self._session = zenoh.open(config)
            self._made_for = (wish.port, file)
        return ZenohLeader(self._session, wish.topic)


class ZenohLeader:
    """Publishes at once, and drops what the network does not take."""

    def __init__(self, session: zenoh.Session, topic: str) -> None:
        self._publisher = session.declare_publisher(
            topic,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        self._in_use = threading.Lock()  # zenoh undeclares nothing that is being used

    @property
    def matching(self) -> bool | None:
        """Whether a follower listens."""
        status: Any = self._publisher.matching_status  # zenoh's stubs call it a bool
        return bool(status.matching)

    def publish(self, payload: bytes) -> None:
        """Send one frame."""
        with self._in_use:
            self._publisher.put(payload)

    def close(self) -> None:
        """Publish no more; the session stays."""
        with self._in_use:
            self._publisher.undeclare()  # type: ignore[no-untyped-call]


class ZenohFollower:
    """Connects to one leader, also to one that is not there yet or comes back."""

    matching = None

    def __init__(self, wish: LinkWish, file: str | None, deliver: Deliver) -> None:
        config = _config(file)
        _listen(config, [])
        host = f"[{wish.host}]" if wish.host is not None and ":" in wish.host else wish.host
        endpoint = f"{_protocol(config)}/{host}:{wish.port}"
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/retry", json.dumps(_RETRY))
        config.insert_json5("open/return_conditions/connect_scouted", "false")
        self._deliver = deliver
        self._session = zenoh.open(config)
        self._subscriber = self._session.declare_subscriber(
            wish.topic, zenoh.handlers.RingChannel(_QUEUED_AT_MOST)
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def publish(self, _payload: bytes) -> None:
        """Say nothing: a follower only listens."""

    def close(self) -> None:
        """Disconnect, which ends the listening, too."""
        self._session.close()  # type: ignore[no-untyped-call]
        self._thread.join(_END_WITHIN_S)

    def _listen(self) -> None:
        while True:
            try:
                sample = self._subscriber.recv()
            except zenoh.ZError:  # closed
                return
            stamp, payload = sample.timestamp, sample.payload
            source = "" if stamp is None else str(stamp.get_id())
            # What is too long is no frame: it need not be copied to be counted.
            content = payload.to_bytes() if len(payload) <= FRAME_BYTES else bytes(FRAME_BYTES + 1)
            self._deliver(content, source)


def _config(file: str | None) -> zenoh.Config:
    """Return zenoh's configuration: the file's, but without any discovery."""
    config: zenoh.Config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("connect/endpoints", "[]")
    return config


def _listen(config: zenoh.Config, endpoints: Sequence[str]) -> None:
    config.insert_json5("listen/endpoints", json.dumps(list(endpoints)))


def _protocol(config: zenoh.Config) -> str:
    """Return tls where the configuration names certificates, else tcp."""
    tls = json.loads(config.get_json("transport/link/tls"))
    return "tls" if any(tls.get(name) for name in _CERTIFICATES) else "tcp"
