"""To whom a leader's datagrams go: one host or several, as a parameter names them."""

import re

from litegripd.model.teleop import LinkWish

MOST_TARGETS = 8
_TARGET = re.compile(r"(\[[^\[\]]+\]|[^:\[\]]+)(?::(\d{1,5}))?")


def udp_targets(wish: LinkWish) -> tuple[tuple[str, int], ...]:
    """Return the hosts and ports that a leader sends to.

    `host` names them, separated by commas, each with a port of its own where that is not the
    link's: `10.0.0.2,10.0.0.3:17449`, `[fe80::1]:17449`. Raises `ValueError` for a port that is
    none, a name that is none, and more than `MOST_TARGETS`.
    """
    names = [name.strip() for name in (wish.host or "").split(",")]
    if len(names) > MOST_TARGETS:
        raise ValueError(f"names {len(names)} followers, {MOST_TARGETS} are the most")
    return tuple(_target(name, wish.port) for name in names)


def _target(name: str, port: int) -> tuple[str, int]:
    if name.count(":") > 1 and not name.startswith("["):
        return name, port  # a plain IPv6 address
    found = _TARGET.fullmatch(name)
    if found is None:
        raise ValueError(f"has {name!r}, which is neither HOST nor HOST:PORT nor [IPV6]:PORT")
    host = found[1].removeprefix("[").removesuffix("]")
    own_port = port if found[2] is None else int(found[2])
    if not 1 <= own_port <= 65_535:
        raise ValueError(f"has the port {own_port}, it must be 1 to 65535")
    return host, own_port
