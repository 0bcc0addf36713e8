"""Gathers the facts: asks the daemon, if one answers, and then the system about its bus."""

from __future__ import annotations

import shlex
import time
from collections.abc import Mapping
from typing import Any

import litegrip_client
from litegrip_client.discovery import (
    GROUP,
    connect,
    is_enabled,
    is_socket_given,
    is_unit_installed,
    socket_paths,
)
from litegrip_client.doctor import gather_configuration, gather_system
from litegrip_client.doctor.facts import Daemon, Facts, System
from litegrip_client.errors import LiteGripError

ANSWER_WITHIN_S = 5.0


def gather(channel: str, socket: str | None, *, channel_chosen: bool) -> Facts:
    """Find out all that the checks need; without a daemon, what can be known without.

    `channel_chosen` tells that somebody asked for this channel by name.
    """
    daemon, failure, hung_pid = _daemon(channel, socket)
    paths = socket_paths(channel, socket) if daemon is None else [daemon.path]
    asked = channel if channel_chosen and socket is None else None
    is_channel_known = daemon is not None or channel_chosen or not is_socket_given(socket)
    file = None
    configuration: Mapping[str, Any] = {}
    if daemon is not None:
        channel = str(daemon.hello.get("channel", channel))
        configuration = daemon.info.get("configuration", {})
    elif is_channel_known:
        file = gather_configuration.configuration(channel)
        configuration = (file.content if file is not None else None) or {}
    bus = configuration.get("bus", {})
    is_read = is_channel_known and (file is None or file.content is not None)
    may_be_it = file is not None and file.unchecked is not None and gather_system.is_can(channel)
    interface = str(bus.get("interface", "socketcan")) if is_read or may_be_it else None
    bus_channel = str(bus.get("channel", channel))
    where = f" -c {channel}" if is_channel_known else ""
    if socket:
        where = f" --socket {shlex.quote(socket)}"
    return Facts(
        channel=channel,
        version=litegrip_client.__version__,
        user=gather_system.user(configuration.get("rpc", {}).get("group", GROUP)),
        system=gather_system.system(interface, bus_channel) if interface else System(),
        sockets=gather_system.sockets(paths),
        daemon=daemon,
        failure=failure,
        ctl=f"litegripctl{where}",
        asked_channel=asked,
        is_unit_enabled=not is_socket_given(socket) and is_enabled(channel),
        is_unit_installed=is_unit_installed(),
        socket=None if is_channel_known else shlex.quote(paths[0]),
        hung_pid=hung_pid,
        configuration=file,
        interface=interface,
        bus_channel=bus_channel,
        now_s=time.time(),
    )


def _daemon(channel: str, socket: str | None) -> tuple[Daemon | None, str | None, int | None]:
    """Return what the daemon says, or why it says nothing, and who listens all the same."""
    pid = 0
    try:
        with connect(channel, socket, ANSWER_WITHIN_S) as connection:
            pid = connection.daemon_pid
            hello = connection.greet("litegripctl doctor")
            answers = [connection.call(method) for method in ("info.get", "health", "state.get")]
            return Daemon(connection.path, hello, *answers), None, None
    except LiteGripError as error:
        return None, error.message, pid if error.reason == "no_answer" else None
