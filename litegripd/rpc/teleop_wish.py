"""Which link teleop.start asks for: the parameters that go together, and those that do not."""

import re
from collections.abc import Mapping
from typing import Any, TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.teleop import DEFAULT_GRIP_ID, DEFAULT_PORT, LinkWish, udp_targets

_GRIP_ID = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_HOST = re.compile(r"[A-Za-z0-9_.:%-]{1,253}")
_HOSTS = re.compile(r"[A-Za-z0-9_.:%,\[\] -]{1,1000}")
"""Nothing that would mean more than a name in a key or an endpoint: no "/", "#", "?" and "*"."""

_Problem: TypeAlias = tuple[str, str] | None
"""A parameter, and what is wrong with it."""


def wish_of(params: Mapping[str, Any]) -> LinkWish | Refusal:
    """Find which link is wanted, or which parameter is wrong."""
    mode, fake = params["mode"], params.get("fake_leader", False)
    wish = LinkWish(
        mode,
        "none" if fake else params.get("link", "zenoh"),
        params.get("host"),
        params.get("port", DEFAULT_PORT),
        params.get("grip_id", DEFAULT_GRIP_ID),
        params.get("reflect_n", 0.0) > 0.0 if mode == "master" else params.get("reflect", False),
    )
    problem = _of_names(wish) or _of_reflection(params, fake=fake) or _of_ends(wish, fake=fake)
    if problem is None:
        return wish
    parameter, text = problem
    message = f"teleop.start: {parameter} {text}"
    return Refusal("invalid_params", message, {"parameter": parameter})


def _of_names(wish: LinkWish) -> _Problem:
    """Look at what becomes a part of keys and endpoints."""
    if not _GRIP_ID.fullmatch(wish.grip_id):
        return "grip_id", f"is {wish.grip_id!r}; it has letters, digits, _ . - (1 to 64)"
    if wish.host is None:
        return None
    if wish.mode == "master" and wish.kind == "udp":
        return _of_targets(wish)
    if not _HOST.fullmatch(wish.host):
        return "host", f"is {wish.host!r}; it must be a host's name or address, without a port"
    return None


def _of_targets(wish: LinkWish) -> _Problem:
    if not _HOSTS.fullmatch(wish.host or ""):
        text = "it must be hosts' names or addresses, separated by commas"
        return "host", f"is {wish.host!r}; {text}"
    try:
        udp_targets(wish)
    except ValueError as error:
        return "host", str(error)
    return None


def _of_reflection(params: Mapping[str, Any], *, fake: bool) -> _Problem:
    """Look at what only one end takes."""
    if params["mode"] == "master":
        if "reflect" in params:
            return "reflect", "is for a slave; a master takes reflect_n, its largest force"
        if "reflect_gain" in params and not params.get("reflect_n"):
            return "reflect_gain", "says nothing without reflect_n, the largest force"
        return None
    for name in ("reflect_n", "reflect_gain"):
        if name in params:
            return name, "is for a master; a slave takes reflect, to tell its force"
    if fake and params.get("reflect", False):
        return "reflect", "needs a leader with a hand, which a fake one has not"
    return None


def _of_ends(wish: LinkWish, *, fake: bool) -> _Problem:
    """Look at who has to know where the other end is."""
    leads, has_host = wish.mode == "master", wish.host is not None
    if leads and fake:
        return "fake_leader", "is for a slave: a master is a leader itself"
    if not leads and not fake and wish.kind == "none":
        return "link", "none brings a slave no frames; for a try: fake_leader"
    if wish.kind == "zenoh" and not leads and not has_host:
        return "host", "is missing: a slave connects to its leader and to nobody else"
    if wish.kind == "zenoh" and leads and has_host:
        return "host", "is for a slave: a master listens, on all its addresses"
    if wish.kind == "udp" and leads and not has_host:
        return "host", "is missing: a master sends its datagrams to its follower"
    return None
