"""Teleoperation: its frames, links of a program's own, and the geometry that both ends share.

The loop is the daemon's (`LiteGrip.teleop_start`); a link that a program injects is carried to it.
"""

from __future__ import annotations

import contextlib
import math
import select
import socket
import struct
from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar

from ._refused import Refused
from .exceptions import LiteGripError
from .models import GripperConfig

__all__ = [
    "DEFAULT_ALIGN_SPEED_MM_S",
    "DEFAULT_DQ_MAX",
    "DEFAULT_GRIP_ID",
    "DEFAULT_GRIP_PORT",
    "DEFAULT_LEAD_CAP_MM",
    "DEFAULT_READY_PERIOD_S",
    "DEFAULT_READY_TIMEOUT_S",
    "DEFAULT_READY_TOLERANCE_MM",
    "DEFAULT_TORQUE_LIMIT_NM",
    "FRAME_SIZE",
    "MAX_FRAME_GAP_S",
    "READY_FRAME_SIZE",
    "TORQUE_REARM_OPENNESS",
    "TORQUE_TRIP_CYCLES",
    "GripperTeleop",
    "InProcTeleopTransport",
    "TeleopBusyError",
    "TeleopError",
    "TeleopNotActiveError",
    "TeleopNotReady",
    "TeleopSubscription",
    "TeleopTransport",
    "UdpTeleopTransport",
    "check_ready",
    "clamp_to_calibrated",
    "decode_frame",
    "decode_ready_frame",
    "encode_frame",
    "encode_ready_frame",
    "openness_to_rad",
    "rad_to_openness",
    "ready_topic",
    "teleop_topic",
    "travel_mm",
]

DEFAULT_GRIP_ID = "gripA"
DEFAULT_GRIP_PORT = 17448
DEFAULT_DQ_MAX = 10.0
MAX_FRAME_GAP_S = 0.05
DEFAULT_ALIGN_SPEED_MM_S = 50.0
DEFAULT_LEAD_CAP_MM = 4.0
DEFAULT_TORQUE_LIMIT_NM = 0.0
TORQUE_TRIP_CYCLES = 3
TORQUE_REARM_OPENNESS = 0.05
DEFAULT_READY_TOLERANCE_MM = 2.0
DEFAULT_READY_PERIOD_S = 0.1
DEFAULT_READY_TIMEOUT_S = 10.0

_FRAME = struct.Struct(">4d")
FRAME_SIZE = _FRAME.size
READY_FRAME_SIZE = 1

_LEAST_TRAVEL_RAD = 1e-6
_MOST_DATAGRAM = 65_536


class TeleopError(LiteGripError):
    """Teleoperation cannot begin or continue."""


class TeleopBusyError(TeleopError):
    """Another session runs on this gripper."""


class TeleopNotActiveError(TeleopError):
    """No teleoperation runs."""


class TeleopNotReady(TeleopError):  # noqa: N818 - the vendor's name
    """The gripper is not calibrated."""


# Frames


def encode_frame(openness: float, position_mm: float, force_n: float, timestamp: float) -> bytes:
    """Return the 32 bytes of a leader's frame."""
    return _FRAME.pack(openness, position_mm, force_n, timestamp)


def decode_frame(payload: bytes) -> tuple[float, float, float, float]:
    """Return openness, position_mm, force_n and timestamp; raises `ValueError` unless 32 bytes."""
    if len(payload) != FRAME_SIZE:
        raise ValueError(f"{len(payload)} bytes are no frame, which has {FRAME_SIZE}")
    openness, position_mm, force_n, timestamp = _FRAME.unpack(payload)
    return openness, position_mm, force_n, timestamp


def encode_ready_frame(ready: bool) -> bytes:
    """Return the byte by which a follower says whether it follows."""
    return b"\x01" if ready else b"\x00"


def decode_ready_frame(payload: bytes) -> bool:
    """Return True for any byte but 0; raises `ValueError` unless it is one byte."""
    if len(payload) != READY_FRAME_SIZE:
        raise ValueError(f"{len(payload)} bytes are no ready frame, which has {READY_FRAME_SIZE}")
    return payload != b"\x00"


def teleop_topic(grip_id: str = DEFAULT_GRIP_ID) -> str:
    """Return the key of the leader's frames."""
    return f"litearm/v4/{grip_id}/gripper_teleop"


def ready_topic(grip_id: str = DEFAULT_GRIP_ID) -> str:
    """Return the key of the follower's ready frames."""
    return f"litearm/v4/{grip_id}/gripper_ready"


# Geometry


def check_ready(cfg: GripperConfig) -> None:
    """Raise `TeleopNotReady` for a gripper whose openness nobody knows."""
    if not cfg.calibrated:
        raise TeleopNotReady("not calibrated: load_calibration(), load_template(name) or zero()")
    if abs(cfg.pos_open_rad - cfg.pos_closed_rad) <= _LEAST_TRAVEL_RAD:
        raise TeleopNotReady("zero travel: the closed and the open limit are equal")
    if cfg.rad_to_mm == 0.0:
        raise TeleopNotReady("rad_to_mm is 0: load a calibration, or zero()")


def travel_mm(cfg: GripperConfig) -> float:
    """Return the travel in mm."""
    return abs(cfg.pos_open_rad - cfg.pos_closed_rad) * cfg.rad_to_mm


def rad_to_openness(position_rad: float, cfg: GripperConfig) -> float:
    """Return the share of the travel that is open, 0 to 1; 0.0 without a travel."""
    travel = travel_mm(cfg)
    if travel <= 0.0:
        return 0.0
    share = (cfg.pos_closed_rad - position_rad) * cfg.close_sign * cfg.rad_to_mm / travel
    return share if math.isnan(share) else min(max(share, 0.0), 1.0)


def openness_to_rad(openness: float, cfg: GripperConfig) -> float:
    """Return the angle of a share of the travel; the closed limit without a scale."""
    if cfg.rad_to_mm <= 0.0:
        return cfg.pos_closed_rad
    share = min(max(openness, 0.0), 1.0)
    return cfg.pos_closed_rad - cfg.close_sign * share * travel_mm(cfg) / cfg.rad_to_mm


def clamp_to_calibrated(cfg: GripperConfig, q: float) -> float:
    """Return the angle, or the limit that it is beyond."""
    low, high = sorted((cfg.pos_closed_rad, cfg.pos_open_rad))
    return min(max(q, low), high)


# Links


class TeleopSubscription:
    """What comes for one topic; a link of a program's own has its own class of it."""

    def try_recv(self) -> bytes | None:
        """Return the oldest payload that waits, None without one; it never waits itself."""
        raise NotImplementedError

    def drain_latest(self) -> bytes | None:
        """Return the newest payload and drop the others; None without one."""
        latest = None
        while (payload := self.try_recv()) is not None:
            latest = payload
        return latest


class TeleopTransport:
    """A link: topics to which payloads are published, and subscriptions to them.

    Give one to `teleop_start(transport=...)`: the client carries its payloads to the daemon, and
    never closes it.
    """

    def pub(self, topic: str, payload: bytes) -> None:
        """Send a payload."""
        raise NotImplementedError

    def sub(self, topic: str) -> TeleopSubscription:
        """Begin to listen to a topic."""
        raise NotImplementedError

    def close(self) -> None:
        """End the link."""


class _Queue(TeleopSubscription):
    """Payloads that wait; the oldest is dropped where there are too many."""

    def __init__(self, depth: int) -> None:
        self._waiting: deque[bytes] = deque(maxlen=depth)

    def put(self, payload: bytes) -> None:
        """Add a payload."""
        self._waiting.append(payload)

    def try_recv(self) -> bytes | None:
        """Return the oldest payload, None without one."""
        try:
            return self._waiting.popleft()
        except IndexError:
            return None


class InProcTeleopTransport(TeleopTransport):
    """A link inside one process; each subscription has a queue of its own, `fifo_depth` deep."""

    def __init__(self, fifo_depth: int = 16) -> None:
        self._depth = fifo_depth
        self._queues: dict[str, list[_Queue]] = {}

    def pub(self, topic: str, payload: bytes) -> None:
        """Put a payload into each queue of the topic."""
        for waiting in self._queues.get(topic, ()):
            waiting.put(bytes(payload))

    def sub(self, topic: str) -> TeleopSubscription:
        """Return a new queue of the topic."""
        waiting = _Queue(self._depth)
        self._queues.setdefault(topic, []).append(waiting)
        return waiting

    def close(self) -> None:
        """Forget all queues."""
        self._queues = {}


class _Datagrams(TeleopSubscription):
    """What comes at a UDP socket."""

    def __init__(self, bound: socket.socket) -> None:
        self._socket = bound

    def try_recv(self) -> bytes | None:
        """Return the oldest datagram, None without one."""
        try:
            readable, _, _ = select.select([self._socket], [], [], 0.0)
            return self._socket.recv(_MOST_DATAGRAM) if readable else None
        except (OSError, ValueError):  # closed, or a refusal of what was sent before
            return None


class UdpTeleopTransport(TeleopTransport):
    """A link over UDP: sends to `pub_addr`, listens at `bind_addr`, each "host:port" or a pair.

    A datagram has no topic: all that comes counts. Raises `ValueError` without any address, and
    `OSError` for a port that is taken.
    """

    def __init__(
        self,
        pub_addr: str | tuple[str, int] | None = None,
        bind_addr: str | tuple[str, int] | None = None,
    ) -> None:
        if pub_addr is None and bind_addr is None:
            raise ValueError("a UDP link needs pub_addr, bind_addr, or both")
        self._to = None if pub_addr is None else _address(pub_addr)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._is_bound = bind_addr is not None
        if bind_addr is not None:
            try:
                self._socket.bind(_address(bind_addr))
            except OSError:
                self._socket.close()
                raise

    def pub(self, topic: str, payload: bytes) -> None:
        """Send a datagram; what the network does not take is lost."""
        if self._to is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(payload, self._to)

    def sub(self, topic: str) -> TeleopSubscription:
        """Return what comes at `bind_addr`; raises `TeleopError` without one."""
        if not self._is_bound:
            raise TeleopError("this UDP link listens nowhere: give it a bind_addr")
        return _Datagrams(self._socket)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _address(given: str | tuple[str, int]) -> tuple[str, int]:
    if not isinstance(given, str):
        return str(given[0]), int(given[1])
    host, colon, port = given.rpartition(":")
    if not colon or not port.isdecimal():
        raise ValueError(f"{given!r} is no address, which is host:port")
    return host, int(port)


class GripperTeleop(Refused):
    """The SDK's loop, which is the daemon's: `LiteGrip.teleop_start(transport=...)` runs it."""

    _INSTEAD: ClassVar[Mapping[str, str]] = {
        "start": "LiteGrip.teleop_start(mode, transport=...)",
        "stop": "LiteGrip.teleop_stop()",
        "status": "LiteGrip.teleop_status()",
        "is_running": "LiteGrip.session",
    }

    def __init__(
        self, gripper: Any, transport: Any, mode: str, topic: str, *_more: Any, **_keywords: Any
    ) -> None:
        super().__init__()
        self.gripper, self.transport, self.mode, self.topic = gripper, transport, mode, topic
