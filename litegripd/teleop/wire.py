"""The packets between the daemon and the process in which its teleoperation link lives.

Its first letter is its kind. To the process: `o`, open this link in place of the present one; `c`,
close it; `f`, a frame to publish; `r`, a frame for the leader of those that came. From it: `f`, a
frame that has come; `s`, the link's status.
"""

import json
import struct
from dataclasses import asdict, dataclass

from litegripd.model.teleop import FORCE_FRAME_BYTES, FRAME_BYTES, Arrival, LinkOptions, LinkStatus

OPEN, CLOSE, FRAME, REPLY, STATUS = b"o", b"c", b"f", b"r", b"s"
_ARRIVED = struct.Struct("<IdB")  # generation, when it came, bytes of the source's name
MAX_PAYLOAD_BYTES = max(FRAME_BYTES, FORCE_FRAME_BYTES) + 1
"""Anything longer is no frame; one more byte is enough to know that."""
_MAX_SOURCE_BYTES = 64
_LONGEST_ERROR = 500


@dataclass(frozen=True, slots=True)
class Order:
    """The link to open; `generation` distinguishes its reports from those of the one before."""

    generation: int
    options: LinkOptions
    zenoh_config: str | None = None


def pack_open(order: Order) -> bytes:
    """Return the packet that opens a link."""
    return OPEN + json.dumps([order.generation, asdict(order.options), order.zenoh_config]).encode()


def unpack_open(body: bytes) -> Order:
    """Return the content of `pack_open`'s packet, without its letter."""
    generation, options, zenoh_config = json.loads(body)
    return Order(generation, LinkOptions(**options), zenoh_config)


def pack_reply(payload: bytes, to: str) -> bytes:
    """Return the packet that replies `payload` to the sender of frames whose name is `to`."""
    name = to.encode()[:_MAX_SOURCE_BYTES]
    return REPLY + bytes([len(name)]) + name + payload


def unpack_reply(body: bytes) -> tuple[bytes, str]:
    """Return the content of `pack_reply`'s packet, without its letter."""
    payload_at = 1 + body[0]
    return body[payload_at:], body[1:payload_at].decode(errors="replace")


def pack_arrival(generation: int, arrival: Arrival) -> bytes:
    """Return the packet for a payload that has come; a long one is cut, and still is no frame."""
    source = arrival.source.encode()[:_MAX_SOURCE_BYTES]
    head = _ARRIVED.pack(generation, arrival.at_s, len(source))
    return FRAME + head + source + arrival.payload[:MAX_PAYLOAD_BYTES]


def unpack_arrival(body: bytes) -> tuple[int, Arrival]:
    """Return the content of `pack_arrival`'s packet, without its letter."""
    generation, at_s, length = _ARRIVED.unpack_from(body)
    payload_at = _ARRIVED.size + length
    source = body[_ARRIVED.size : payload_at].decode(errors="replace")
    return generation, Arrival(body[payload_at:], at_s, source)


def pack_status(generation: int, status: LinkStatus) -> bytes:
    """Return the packet that reports a link's status."""
    error = None if status.error is None else status.error[:_LONGEST_ERROR]
    values = [generation, status.state, error, status.matching, status.dropped, status.is_protected]
    return STATUS + json.dumps(values).encode()


def unpack_status(body: bytes) -> tuple[int, LinkStatus]:
    """Return the content of `pack_status`'s packet, without its letter."""
    generation, *values = json.loads(body)
    return generation, LinkStatus(*values)
