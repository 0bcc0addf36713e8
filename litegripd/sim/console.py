"""Reads commands for a running simulator from a file descriptor, line by line, without waiting.

What the lines mean is in `commands`. It never raises for what comes in: a line that cannot be
carried out is answered with a sentence. The end of the input changes nothing.
"""

from __future__ import annotations

import os
import select
from collections.abc import Callable

from litegripd.sim.commands import Simulator, parse

_READ_BYTES = 4096
_LONGEST = 200


class Console:
    """The commands that come from `fd`; without one, none come.

    `say` is given what is to be told: what went wrong with a line, and help.
    """

    def __init__(self, fd: int | None, simulator: Simulator, say: Callable[[str], None]) -> None:
        self._fd = fd
        self._simulator = simulator
        self._say = say
        self._rest = b""
        self._poller = select.poll()
        if fd is not None:
            self._poller.register(fd, select.POLLIN)

    def serve(self) -> None:
        """Carry out the lines that have come."""
        if self._fd is None or not self._poller.poll(0) or _is_in_background(self._fd):
            return
        try:
            data = os.read(self._fd, _READ_BYTES)
        except OSError:
            data = b""  # A terminal that has gone ends the input as well.
        if not data:
            self._fd = None
            data = b"\n"  # A last line may lack its end.
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[: _LONGEST + 1]
        for line in lines:
            self._carry_out(line)

    def _carry_out(self, line: bytes) -> None:
        try:
            if len(line) > _LONGEST:
                raise ValueError(f"a command has at most {_LONGEST} characters")
            said = parse(line.decode(errors="replace"))(self._simulator)
        except (ValueError, OSError) as error:
            said = str(error)
        if said is not None:
            self._say(said)


def _is_in_background(fd: int) -> bool:
    """Whether what is typed is meant for another program: reading it would stop this process."""
    try:
        return os.isatty(fd) and os.tcgetpgrp(fd) != os.getpgrp()
    except OSError:
        return False  # A terminal that does not control this process stops nobody.
