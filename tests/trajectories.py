"""Trajectories for tests: files made from the format's description alone, sent and played."""

import base64
import hashlib
import math
import struct
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from litegripd.model.calibration import NOMINAL

HEADER_BYTES = 66
SAMPLE_BYTES = 40
PIECE_BYTES = 8192


class Caller(Protocol):
    """A client of a daemon, whatever is between them."""

    def result(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method that is expected to succeed."""


Point = tuple[float, float]
"""Seconds, and the openness then."""


def lgt(
    points: Iterable[Point],
    *,
    magic: bytes = b"LGRTRJ01",
    version: int = 1,
    count: int | None = None,
    sample_hz: float = 100.0,
    created_s: float = 1.7e9,
    closed_rad: float = NOMINAL[0].closed_rad,
    open_rad: float = NOMINAL[0].open_rad,
    rad_to_mm: float = NOMINAL[0].rad_to_mm,
    can_id: int = 8,
    mount: bytes = b"normal\0\0",
) -> bytes:
    """Write a file field by field, whether it may be so or not."""
    samples = [struct.pack("<ddddd", t_s, openness, 0.0, 0.0, 0.0) for t_s, openness in points]
    head = magic + version.to_bytes(2, "little")
    head += (len(samples) if count is None else count).to_bytes(4, "little")
    for figure in (sample_hz, created_s, closed_rad, open_rad, rad_to_mm):
        head += struct.pack("<d", figure)
    head += can_id.to_bytes(4, "little") + mount
    assert len(head) == HEADER_BYTES
    return head + b"".join(samples)


def points_of(content: bytes) -> list[tuple[float, ...]]:
    """Read the samples of a file field by field."""
    body = content[HEADER_BYTES:]
    assert len(body) % SAMPLE_BYTES == 0
    return [
        struct.unpack("<ddddd", body[at : at + SAMPLE_BYTES])
        for at in range(0, len(body), SAMPLE_BYTES)
    ]


def sampled(
    openness_at: Callable[[float], float], duration_s: float, hz: float = 100.0, first_s: float = 0
) -> list[Point]:
    """Sample a motion."""
    count = round(duration_s * hz) + 1
    return [(first_s + number / hz, openness_at(number / hz)) for number in range(count)]


def swing(
    middle: float = 0.5, size: float = 0.3, period_s: float = 4.0
) -> Callable[[float], float]:
    """Return a motion to and fro."""
    return lambda t_s: middle + size * math.sin(2.0 * math.pi * t_s / period_s)


def pieces(content: bytes, **more: Any) -> list[dict[str, Any]]:
    """Return the parameters with which a file is sent."""
    common = {"total": len(content), "sha256": hashlib.sha256(content).hexdigest(), **more}
    return [
        {"offset": at, "data": base64.b64encode(content[at : at + PIECE_BYTES]).decode(), **common}
        for at in range(0, len(content), PIECE_BYTES)
    ]


def send(client: Caller, content: bytes, **more: Any) -> dict[str, Any]:
    """Send a whole file; return the last answer."""
    answer: dict[str, Any] = {}
    for piece in pieces(content, **more):
        answer = client.result("trajectory.put", **piece)
    return answer


def uploaded(client: Caller, points: Iterable[Point], **more: Any) -> str:
    """Send a trajectory for this connection; return its name."""
    name: str = send(client, lgt(points, **more))["name"]
    return name


def fetched(client: Caller, **source: Any) -> bytes:
    """Fetch a whole file, and check it by what is told of it."""
    whole, total, sha256 = b"", 1, ""
    while len(whole) < total:
        piece = client.result("trajectory.get", offset=len(whole), **source)
        total, sha256 = piece["total"], piece["sha256"]
        whole += base64.b64decode(piece["data"])
    assert hashlib.sha256(whole).hexdigest() == sha256
    return whole
