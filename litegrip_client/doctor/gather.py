"""Gathers the facts: asks the daemon, if one answers, and then the system about its bus."""

from __future__ import annotations

import shlex
import time
from collections.abc import Mapping
from typing import Any

import litegrip_client
from litegrip_client.discovery import GROUP, connect, is_enabled, socket_paths
from litegrip_client.doctor import gather_system
from litegrip_client.doctor.facts import Daemon, Facts
from litegrip_client.errors import LiteGripError


def gather(channel: str, socket: str | None, *, channel_chosen: bool) -> Facts:
    """Find out all that the checks need; without a daemon, what can be known without.

    `channel_chosen` tells that somebody asked for this channel by name.
    """
    daemon, failure = _daemon(channel, socket)
    paths = socket_paths(channel, socket) if daemon is None else [daemon.path]
    asked = channel if channel_chosen and socket is None else None
    configuration: Mapping[str, Any] = {}
    if daemon is not None:
        channel = str(daemon.hello.get("channel", channel))
        configuration = daemon.info.get("configuration", {})
    bus = configuration.get("bus", {})
    interface = str(bus.get("interface", "socketcan"))
    bus_channel = str(bus.get("channel", channel))
    where = f"--socket {shlex.quote(socket)}" if socket else f"-c {channel}"
    return Facts(
        channel=channel,
        version=litegrip_client.__version__,
        user=gather_system.user(configuration.get("rpc", {}).get("group", GROUP)),
        system=gather_system.system(interface, bus_channel),
        sockets=gather_system.sockets(paths),
        daemon=daemon,
        failure=failure,
        ctl=f"litegripctl {where}",
        asked_channel=asked,
        is_unit_enabled=socket is None and is_enabled(channel),
        interface=interface,
        bus_channel=bus_channel,
        now_s=time.time(),
    )


def _daemon(channel: str, socket: str | None) -> tuple[Daemon | None, str | None]:
    """Return what the daemon says, or why it says nothing."""
    try:
        with connect(channel, socket) as connection:
            hello = connection.greet("litegripctl doctor")
            answers = [connection.call(method) for method in ("info.get", "health", "state.get")]
            return Daemon(connection.path, hello, *answers), None
    except LiteGripError as error:
        return None, error.message
