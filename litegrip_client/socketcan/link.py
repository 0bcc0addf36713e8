"""A CAN interface as iproute2 describes it, and what of that keeps a motor from answering.

The doctor and the daemon's helper process read it in the same way.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

BITRATE = 1_000_000
"""bit/s; the motor's."""

HINDERING = {
    "LISTEN-ONLY": "the adapter only listens: it sends nothing and acknowledges nothing",
    "LOOPBACK": "the adapter hears itself instead of the bus",
    "RESTRICTED": "the adapter acknowledges, but sends nothing",
}
"""Modes of a controller in which no motor can answer, and why."""

HARMFUL = {
    "FD": "the motor speaks classic CAN, and a frame of CAN FD that any program sends is an error"
    " to it",
    "FD-NON-ISO": "that is CAN FD before its standard, and the motor speaks classic CAN",
    "XL": "the motor speaks classic CAN, and a frame of CAN XL is an error to it",
    "ONE-SHOT": "a frame that meets another one, or an error, is lost and not repeated",
    "TRIPLE-SAMPLING": "each bit is sampled three times, which is for slow buses",
    "PRESUME-ACK": "a frame that nobody has acknowledged counts as sent, so that a dead bus looks"
    " like one that works",
}
"""Modes in which a motor may answer, but frames are lost or faults are hidden, and why."""

_FD_MTU = 72
"""Of an interface in FD mode; 16 is that of classic CAN, and CAN XL has more."""


@dataclass(frozen=True, slots=True)
class Link:
    """A network interface; None where that is not known, or where its kind has no such thing."""

    name: str
    is_can: bool
    is_up: bool
    kind: str | None = None
    """As iproute2 names it: "can" for an adapter, "vcan"; None without iproute2's answer."""
    queue_frames: int | None = None
    bitrate: int | None = None
    sample_point: float | None = None
    restart_ms: int | None = None
    state: str | None = None
    """The controller's: ERROR-ACTIVE, ERROR-WARNING, ERROR-PASSIVE, BUS-OFF, STOPPED, ..."""
    tx_errors: int | None = None
    rx_errors: int | None = None
    history: Mapping[str, int] = field(default_factory=dict)
    """What has happened since the driver was loaded: bus_off, bus_error, error_passive, ..."""
    termination_ohm: int | None = None
    """Of the adapter's own resistor between the wires, 0 where it is off; None where it has none
    that can be switched."""
    index: int | None = None
    """The kernel's number, which stays with an interface that is renamed."""
    modes: tuple[str, ...] = ()
    """The controller's modes that are on, as iproute2 names them: LISTEN-ONLY, FD, ..."""

    @property
    def bad_modes(self) -> dict[str, str]:
        """The modes that are on and should not be, those that hinder most first, and why."""
        known = {**HINDERING, **HARMFUL}
        return {mode: why for mode, why in known.items() if mode in self.modes}


def from_ip(text: str) -> Link:
    """Read the answer of `ip -details -statistics -json link show <name>`.

    Raises `ValueError` for what is no such answer: other programs named ip know no JSON.
    """
    links = json.loads(text)
    if not isinstance(links, list) or len(links) != 1 or not isinstance(links[0], dict):
        raise ValueError("not the description of one interface")
    link = links[0]
    info = _mapping(link, "linkinfo")
    data, counters = _mapping(info, "info_data"), _mapping(info, "info_xstats")
    timing, errors = _mapping(data, "bittiming"), _mapping(data, "berr_counter")
    point = timing.get("sample_point")  # printed as a text: "0.750"
    kind, told = info.get("info_kind"), data.get("ctrlmode")
    modes = [str(mode).upper() for mode in told] if isinstance(told, list) else []
    if kind == "can" and _integer(link.get("mtu")) == _FD_MTU and "FD" not in modes:
        modes.append("FD")
    return Link(
        name=str(link.get("ifname")),
        is_can=link.get("link_type") == "can",
        is_up="UP" in link.get("flags", ()),
        kind=kind,
        queue_frames=_integer(link.get("txqlen")),
        bitrate=_integer(timing.get("bitrate")) or None,
        sample_point=float(point) if isinstance(point, str | int | float) else None,
        restart_ms=_integer(data.get("restart_ms")),
        state=data.get("state"),
        tx_errors=_integer(errors.get("tx")),
        rx_errors=_integer(errors.get("rx")),
        termination_ohm=_integer(data.get("termination")),
        history={name: value for name, value in counters.items() if isinstance(value, int)},
        index=_integer(link.get("ifindex")),
        modes=tuple(modes),
    )


def from_files(name: str, files: Mapping[str, str]) -> Link:
    """Read /sys/class/net/<name>/: the contents of `type`, `flags` and `tx_queue_len`.

    They have no bit rate and no error counters. Raises `ValueError` for what is no number.
    """
    return Link(
        name=name,
        is_can=int(files["type"]) == ARPHRD_CAN,
        is_up=bool(int(files["flags"], 16) & _IFF_UP),
        queue_frames=int(files["tx_queue_len"]),
        index=int(files["ifindex"]) if "ifindex" in files else None,
    )


ARPHRD_CAN = 280
"""The type of a CAN interface in /sys/class/net/<name>/type (linux/if_arp.h)."""

_IFF_UP = 0x1


def _mapping(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, Mapping) else {}


def _integer(value: object) -> int | None:
    return value if isinstance(value, int) else None


IP_WITHIN_S = 5.0
_ADMIN_PATHS = ("/usr/sbin", "/sbin")


class IpError(Exception):
    """iproute2 is not there, or gave no usable answer; the message says which."""


def ask_ip(name: str) -> str | None:
    """Return what iproute2 says of an interface, None if it does not exist. Raises `IpError`."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *_ADMIN_PATHS])
    program = shutil.which("ip", path=path)
    if program is None:
        raise IpError("ip (iproute2) is not installed")
    command = [program, "-details", "-statistics", "-json", "link", "show", name]
    environment = {**os.environ, "LC_ALL": "C"}
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=IP_WITHIN_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise IpError(f"ip cannot be run: {error}") from error
    if done.returncode == 0:
        return done.stdout.decode(errors="replace")
    complaint = done.stderr.decode(errors="replace").strip()
    if "does not exist" in complaint:
        return None
    raise IpError(f"ip ended with {done.returncode}: {complaint or 'no word'}")


_MODE_BITS = {
    0x01: "LOOPBACK",
    0x02: "LISTEN-ONLY",
    0x04: "TRIPLE-SAMPLING",
    0x08: "ONE-SHOT",
    0x10: "BERR-REPORTING",
    0x20: "FD",
    0x40: "PRESUME-ACK",
    0x80: "FD-NON-ISO",
    0x800: "RESTRICTED",
    0x1000: "XL",
}
"""CAN_CTRLMODE_* of linux/can/netlink.h, by iproute2's names."""
_HEADER, _LINK, _ATTRIBUTE = struct.Struct("=IHHII"), struct.Struct("=BxHiII"), struct.Struct("=HH")
_NEWLINK, _GETLINK, _REQUEST = 16, 18, 1
_IFNAME, _LINKINFO, _KIND, _DATA, _BITTIMING, _CTRLMODE = 3, 18, 1, 2, 1, 5
_NESTED = 0x3FFF
"""The bits of an attribute's type that are not flags."""


def ask_kernel(name: str) -> Link | None:
    """Ask the kernel itself for kind, bit rate and modes of an interface; None if there is none.

    For who may not run iproute2: it gives its rights up at its start, and ends where a unit's
    filter of system calls forbids that. Raises `OSError`.
    """
    attribute = _ATTRIBUTE.pack(_ATTRIBUTE.size + len(name) + 1, _IFNAME) + name.encode() + b"\0"
    body = _LINK.pack(0, 0, 0, 0, 0) + attribute + bytes(-len(attribute) % 4)
    request = _HEADER.pack(_HEADER.size + len(body), _GETLINK, _REQUEST, 1, 0) + body
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as asked:
        asked.settimeout(IP_WITHIN_S)
        asked.sendto(request, (0, 0))
        return from_netlink(asked.recv(65_536))


def from_netlink(message: bytes) -> Link | None:
    """Read the kernel's answer to RTM_GETLINK; None for its error that there is no such link."""
    if len(message) < _HEADER.size + _LINK.size or _HEADER.unpack_from(message)[1] != _NEWLINK:
        return None
    _family, kind, index, flags, _change = _LINK.unpack_from(message, _HEADER.size)
    found = _attributes(message[_HEADER.size + _LINK.size :])
    info = _attributes(found.get(_LINKINFO, b""))
    data = _attributes(info.get(_DATA, b""))
    timing, modes = data.get(_BITTIMING, b""), data.get(_CTRLMODE, b"")
    bits = int.from_bytes(modes[4:8], sys.byteorder)
    return Link(
        name=found.get(_IFNAME, b"").rstrip(b"\0").decode(errors="replace"),
        is_can=kind == ARPHRD_CAN,
        is_up=bool(flags & _IFF_UP),
        kind=info.get(_KIND, b"").rstrip(b"\0").decode(errors="replace") or None,
        bitrate=int.from_bytes(timing[:4], sys.byteorder) or None,
        index=index,
        modes=tuple(mode for bit, mode in _MODE_BITS.items() if bits & bit),
    )


def _attributes(data: bytes) -> dict[int, bytes]:
    found: dict[int, bytes] = {}
    while len(data) >= _ATTRIBUTE.size:
        length, kind = _ATTRIBUTE.unpack_from(data)
        if length < _ATTRIBUTE.size:
            break
        found[kind & _NESTED] = data[_ATTRIBUTE.size : length]
        data = data[length + -length % 4 :]
    return found


def rate_text(bitrate: int) -> str:
    """Return a bit rate in words."""
    return f"{bitrate / 1e6:g} Mbit/s"


def switch_off(link: Link) -> str:
    """Return the words that `ip link set NAME type can` needs to switch the bad modes off."""
    return "".join(f" {mode.lower()} off" for mode in link.bad_modes)
