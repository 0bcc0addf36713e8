"""What every command works with: the way to the daemon, the run, and its exit codes.

The way leads to the sockets of this machine, or by ssh to those of another (see `remote`). This
module must not know single commands.
"""

from __future__ import annotations

import shlex
import sys
from argparse import Namespace
from collections.abc import Callable, Mapping
from pathlib import Path

from litegrip_client.blocking import connect
from litegrip_client.connection import Connection
from litegrip_client.ctl.output import Output
from litegrip_client.discovery import socket_paths
from litegrip_client.errors import CommandError
from litegrip_client.voices import in_shell

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from types import TracebackType
    from typing import Any, TypeAlias

    from litegrip_client.ctl.parser import LateParser


class Way:
    """To a daemon of this machine, as the command line names it."""

    not_listening: tuple[type[Exception], ...] = (
        FileNotFoundError,
        ConnectionRefusedError,
        PermissionError,
        TimeoutError,
    )
    """What a stop raises where nobody listens for stops, or not to this user, who is told so by the
    other socket."""

    def __init__(self, options: Namespace) -> None:
        self.options = options

    def connect(self) -> Connection:
        """Connect, and make sure that it is the daemon that is meant; raises `LiteGripError`."""
        connection = self._connected()
        connection.voice = in_shell
        try:
            self._check(connection.greet("litegripctl"), connection.path)
        except BaseException:
            connection.close()
            raise
        return connection

    def paths(self) -> list[str]:
        """List the sockets where the daemon may be found, here."""
        return socket_paths(self.options.channel, self.options.socket)

    def content(self, path: str) -> bytes:
        """Read a file of the daemon's machine; raises `OSError`."""
        return Path(path).read_bytes()

    def close(self) -> None:
        """Leave nothing behind."""

    def __enter__(self) -> Way:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _connected(self) -> Connection:
        return connect(self.options.channel, self.options.socket)

    def _check(self, hello: Mapping[str, Any], path: str) -> None:
        options = self.options
        if options.channel_chosen and options.socket is None:
            if hello["channel"] == options.channel:
                return
            raise CommandError(
                f"the daemon at {path} has channel {hello['channel']}, not {options.channel}",
                reason="wrong_gripper",
                data={"hint": "see the variable LITEGRIPD_SOCKET"},
            )


def way_of(options: Namespace) -> Way:
    """Return the way that the command line asks for."""
    if options.ssh_host is None:
        return Way(options)
    from litegrip_client.ctl.remote import SshWay  # noqa: PLC0415 - seldom needed

    return SshWay(options)


OK = 0
NOT_OK = 1
WRONG_USAGE = 2
INTERRUPTED = 130

ENDING = ("cancelled", "running")
"""States of a job after its cancelling; one that still runs ends with the next tick."""


class Run:
    """What a command works with; one that needs no daemon gets no connection."""

    __slots__ = ("_connection", "options", "output", "way")

    def __init__(
        self, connection: Connection | None, options: Namespace, output: Output, way: Way
    ) -> None:
        self._connection = connection
        self.options = options
        self.output = output
        self.way = way

    @property
    def connection(self) -> Connection:
        """The connection to the daemon."""
        if self._connection is None:
            raise RuntimeError(f"{self.options.command} is run without a daemon")
        return self._connection

    def refuse(self, text: str, hint: str) -> int:
        """Say that it cannot be used like this, and what to do; returns the exit code."""
        self.output.error(CommandError(text, reason="wrong_usage"), hint)
        return WRONG_USAGE


def installing(*libraries: str) -> str:
    """Return the command that installs libraries where this program looks for them."""
    return f"{shlex.quote(sys.executable)} -m pip install {' '.join(libraries)}"


Command: TypeAlias = Callable[[Run], int]
"""Carries out one command; returns its exit code."""
Fill: TypeAlias = "Callable[[LateParser], None]"
"""Adds what a command takes to its parser."""
Commands: TypeAlias = "Mapping[str, tuple[Command, Fill | None]]"
"""What carries out the commands of a module, by their names, and what adds their arguments."""
