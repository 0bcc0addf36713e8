"""What every command works with, and the exit codes that are no error's.

It must not know single commands.
"""

from __future__ import annotations

import shlex
import sys
from argparse import Namespace
from collections.abc import Callable, Mapping

from litegrip_client.connection import Connection
from litegrip_client.ctl.output import Output
from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeAlias

    from litegrip_client.ctl.parser import LateParser
    from litegrip_client.ctl.way import Way

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
