"""Reads what iproute2 and the kernel's files say of a network interface. It asks neither."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from litegrip_client.doctor.facts import Link

ARPHRD_CAN = 280
"""The type of a CAN interface in /sys/class/net/<name>/type (linux/if_arp.h)."""

_IFF_UP = 0x1


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
    return Link(
        name=str(link.get("ifname")),
        is_can=link.get("link_type") == "can",
        is_up="UP" in link.get("flags", ()),
        kind=info.get("info_kind"),
        queue_frames=_integer(link.get("txqlen")),
        bitrate=_integer(timing.get("bitrate")),
        sample_point=_number(timing.get("sample_point")),
        restart_ms=_integer(data.get("restart_ms")),
        state=data.get("state"),
        tx_errors=_integer(errors.get("tx")),
        rx_errors=_integer(errors.get("rx")),
        history={name: value for name, value in counters.items() if isinstance(value, int)},
    )


def from_files(name: str, files: Mapping[str, str]) -> Link:
    """Read /sys/class/net/<name>/: the contents of `type`, `flags` and `tx_queue_len`.

    They tell no bit rate and no error counters. Raises `ValueError` for what is no number.
    """
    return Link(
        name=name,
        is_can=int(files["type"]) == ARPHRD_CAN,
        is_up=bool(int(files["flags"], 16) & _IFF_UP),
        queue_frames=int(files["tx_queue_len"]),
    )


def _mapping(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, Mapping) else {}


def _integer(value: object) -> int | None:
    return value if isinstance(value, int) else None


def _number(value: object) -> float | None:
    """Read a number that iproute2 prints as a text: "0.750"."""
    return float(value) if isinstance(value, str | int | float) else None
