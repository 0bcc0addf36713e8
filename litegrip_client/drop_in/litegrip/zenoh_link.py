"""The link over zenoh: a leader listens, a follower connects to it. Needs eclipse-zenoh.

These are ends in the program's own process. `LiteGrip.teleop_start` needs none of them: the
daemon has the link.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from typing import Any

try:
    import zenoh
except ImportError as error:
    raise ImportError(
        "teleoperation over zenoh in this process needs eclipse-zenoh: pip install eclipse-zenoh"
    ) from error

from .teleop import (
    DEFAULT_GRIP_PORT,
    READY_FRAME_SIZE,
    TeleopError,
    TeleopSubscription,
    TeleopTransport,
    encode_ready_frame,
)

__all__ = [
    "DEFAULT_GRIP_PORT",
    "Connector",
    "LatestSlot",
    "Listener",
    "ZenohTeleopTransport",
]


class LatestSlot:
    """Holds the newest payload; `dropped` counts those that nobody took before the next came."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._payload: bytes | None = None
        self._came_s: float | None = None
        self.dropped = 0

    def put(self, payload: bytes, now: float) -> None:
        """Take a payload that came at `now`."""
        with self._lock:
            self.dropped += self._payload is not None
            self._payload, self._came_s = payload, now

    def take(self) -> tuple[bytes | None, float | None]:
        """Return the payload, once, and when the newest came."""
        with self._lock:
            payload, self._payload = self._payload, None
            return payload, self._came_s

    @property
    def ever_received(self) -> bool:
        """True if anything has come."""
        return self._came_s is not None

    def peek_age(self, now: float) -> float | None:
        """Return how long ago the newest came, None before any."""
        return None if self._came_s is None else max(now - self._came_s, 0.0)


class _Taken(TeleopSubscription):
    """What comes for one key."""

    def __init__(self, slot: LatestSlot) -> None:
        self._slot = slot

    def try_recv(self) -> bytes | None:
        """Return the newest payload that nobody has taken."""
        return self._slot.take()[0]


LOG = logging.getLogger("litegrip.zenoh")


def _opened(where: str, endpoint: str) -> zenoh.Session:
    """Return a session without discovery, which listens at or connects to one endpoint."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5(f"{where}/endpoints", json.dumps([endpoint]))
    if where == "connect":
        # The leader may be started later.
        config.insert_json5("connect/timeout_ms", "-1")
        config.insert_json5("connect/exit_on_failure", "false")
        config.insert_json5("listen/endpoints", "[]")
    LOG.info("zenoh session: %s %s", where, endpoint)
    return zenoh.open(config)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(
        key, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.REAL_TIME
    )


def _into(slot: LatestSlot, on_frame: Callable[[bytes], None] | None = None) -> Any:
    def take(sample: zenoh.Sample) -> None:
        payload = bytes(sample.payload.to_bytes())
        slot.put(payload, time.monotonic())
        if on_frame is not None:
            on_frame(payload)

    return take


class Listener:
    """A leader's end: listens at a port, and publishes under a key."""

    def __init__(self, port: int, key: str, ready_key: str | None = None) -> None:
        self._session = _opened("listen", f"tcp/0.0.0.0:{port}")
        self._publisher = _publisher(self._session, key)
        self._ready = LatestSlot()
        if ready_key is not None:
            self._session.declare_subscriber(ready_key, _into(self._ready))

    def put(self, payload: bytes) -> None:
        """Publish a payload."""
        self._publisher.put(payload)

    @property
    def matching(self) -> bool:
        """True if somebody listens."""
        status: Any = self._publisher.matching_status
        return bool(status.matching)

    def ready_subscription(self) -> TeleopSubscription:
        """Return what followers say of being ready."""
        return _Taken(self._ready)

    def close(self) -> None:
        """End the session."""
        self._session.close()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()


class Connector:
    """A follower's end: connects to a leader; `on_frame` is called from zenoh's thread."""

    def __init__(
        self,
        host: str,
        port: int,
        key: str,
        on_frame: Callable[[bytes], None] | None = None,
        ready_key: str | None = None,
    ) -> None:
        self._session = _opened("connect", f"tcp/{host}:{port}")
        self._slot = LatestSlot()
        self._received = 0
        self._on_frame = on_frame
        self._session.declare_subscriber(key, _into(self._slot, self._count))
        self._ready = None if ready_key is None else _publisher(self._session, ready_key)

    def _count(self, payload: bytes) -> None:
        self._received += 1
        if self._on_frame is not None:
            self._on_frame(payload)

    @property
    def received(self) -> int:
        """How many frames have come."""
        return self._received

    def latest(self) -> bytes | None:
        """Return the newest frame that was not taken yet, None without one."""
        return self._slot.take()[0]

    def put_ready(self, payload: bytes) -> None:
        """Say whether this follower is ready; raises `ValueError` unless it is one byte."""
        if len(payload) != READY_FRAME_SIZE:
            raise ValueError(f"{len(payload)} bytes are no ready frame")
        if self._ready is not None:
            self._ready.put(payload)

    def close(self) -> None:
        """End the session."""
        self._session.close()


class ZenohTeleopTransport(TeleopTransport):
    """A link over zenoh for one key: `role` "master" listens, "slave" connects to `host`."""

    def __init__(
        self,
        role: str,
        key: str,
        port: int = DEFAULT_GRIP_PORT,
        host: str | None = None,
        ready_key: str | None = None,
    ) -> None:
        if role not in ("master", "slave"):
            raise ValueError(f"role is {role!r}, it must be master or slave")
        if role == "slave" and not host:
            raise ValueError("a slave needs the master's host")
        self._key, self._ready_key = key, ready_key
        self._frames = _Taken(LatestSlot())
        self._listener: Listener | None = None
        self._connector: Connector | None = None
        if role == "master":
            self._listener = Listener(port, key, ready_key)
        else:
            slot = LatestSlot()
            self._frames = _Taken(slot)
            self._connector = Connector(
                str(host), port, key, lambda payload: slot.put(payload, time.monotonic()), ready_key
            )

    @property
    def matching(self) -> bool | None:
        """True if somebody listens; None for a slave."""
        return None if self._listener is None else self._listener.matching

    @property
    def received(self) -> int:
        """How many frames have come."""
        return 0 if self._connector is None else self._connector.received

    def pub(self, topic: str, payload: bytes) -> None:
        """Publish under the link's key, or say that this follower is ready under its ready key."""
        if self._listener is not None and topic == self._key:
            self._listener.put(payload)
        elif self._connector is not None and topic == self._ready_key is not None:
            self._connector.put_ready(encode_ready_frame(payload != b"\x00"))
        else:
            raise TeleopError(f"this link publishes nothing under {topic}: its key is {self._key}")

    def sub(self, topic: str) -> TeleopSubscription:
        """Return what comes for the link's key, or, for a master, for its ready key."""
        if self._connector is not None and topic == self._key:
            return self._frames
        if self._listener is not None and topic == self._ready_key is not None:
            return self._listener.ready_subscription()
        raise TeleopError(f"this link listens to nothing under {topic}: its key is {self._key}")

    def close(self) -> None:
        """End the session."""
        for end in (self._listener, self._connector):
            if end is not None:
                end.close()
