"""Where the sockets of a channel's daemon are, and how much a stop may stop.

A stop from a shell waits for what is imported here, so that is the least.
"""

from __future__ import annotations

import os

TYPE_CHECKING = False
if TYPE_CHECKING:  # its abstract classes take 2.4 ms, a quarter of what a plain stop may take
    from collections.abc import Mapping
    from typing import Any

SOCKET_VARIABLE = "LITEGRIPD_SOCKET"
CHANNEL_VARIABLE = "LITEGRIP_CHANNEL"
DEFAULT_CHANNEL = "can0"
SYSTEM_DIRECTORY = "/run/litegripd"
PORTAL_DIRECTORY = "/run/litegripd-portal"
"""The sockets of grippers of other machines, which are called SITE.GRIPPER. The directory is the
portal's own: it must not be able to pose as a daemon of this machine."""

STOP_END = ".stop.sock"
STOP_LEVELS = ("hold", "relax", "disable")
NOT_REACHED = "the motor does not answer, so nothing reaches it: to be sure, cut its power"
"""What to say of a stop that is latched, but `is_reached` is False."""


def is_reached(latched: Mapping[str, Any]) -> bool:
    """Return False if the answer to a stop says that the motor does not hear of it.

    An older daemon's stop socket does not tell: then True.
    """
    motor = latched.get("motor", (latched.get("state") or {}).get("motor"))
    return motor not in ("silent", "unknown")


def directories(environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return where the daemons of this machine may have their sockets, in the order to try."""
    own = environment.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}"
    return SYSTEM_DIRECTORY, f"{own}/litegripd"


def paths(channel: str, socket_path: str | None, environment: Mapping[str, str]) -> list[str]:
    """Return the paths where the daemon of `channel` may be found, in the order to try.

    An explicit `socket_path` or else `LITEGRIPD_SOCKET` is the only one when given.
    """
    chosen = socket_path if socket_path is not None else environment.get(SOCKET_VARIABLE)
    if chosen:
        return [os.fspath(chosen)]
    folders = directories(environment)
    if "." in channel:
        folders = (*folders, PORTAL_DIRECTORY)
    return [f"{folder}/{channel}.sock" for folder in folders]


def stop_path(path: str) -> str:
    """Return the socket for stops that belongs to the socket at `path`, or is it."""
    return path if is_for_stops(path) else f"{path.removesuffix('.sock')}{STOP_END}"


def is_for_stops(path: str) -> bool:
    """Return True for a daemon's socket for stops: it takes whatever is sent there for a stop."""
    return path.endswith(STOP_END)
