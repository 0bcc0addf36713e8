"""What every command works with: the daemon, the output, files, and exit codes.

Questions go to standard error, so that standard output keeps results only. This module must not
know single commands.
"""

from __future__ import annotations

import json
import shlex
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Generator, Mapping

from litegrip_client.core.discovery import (
    channels_with_socket,
    is_socket_given,
    running_channels,
)
from litegrip_client.core.session import different
from litegrip_client.core.sockets import DEFAULT_CHANNEL
from litegrip_client.ctl.streams import write
from litegrip_client.line.connection import Connection
from litegrip_client.line.exchange import DEFAULT_TIMEOUT_S
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import CommandError, ConnectError, LiteGripError
from litegrip_client.values.version import is_of_debian

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeAlias

    from litegrip_client.ctl.parser import Fill
    from litegrip_client.values.figures import Here
    from litegrip_client.values.terms import Voice


class Output:
    """Standard output and standard error, for a person or (`as_json`) for a program."""

    def __init__(self, *, as_json: bool) -> None:
        self.as_json = as_json
        self.live = sys.stdout.isatty() and not as_json
        """True if a line can be written over."""
        self._open_line = False

    def result(self, data: Mapping[str, Any], text: str) -> None:
        """Print a result: as it came, or as `text`."""
        self.end_line()
        shown = json.dumps(data, ensure_ascii=False) if self.as_json else text
        self.write(f"{shown}\n")

    def line(self, text: str) -> None:
        """Write `text` over the line before, if that was written by this, too.

        What a terminal has no room for is left out: a line that wraps cannot be written over.
        """
        from shutil import get_terminal_size  # noqa: PLC0415 - only a live line needs it

        room = max(1, get_terminal_size().columns - 1)  # in the last column some terminals wrap
        shown = text if len(text) <= room else f"{text[: room - 1]}…"
        self.write(f"\r{shown}\x1b[K")
        self._open_line = True

    def erase_line(self) -> None:
        """Erase the line that `line` wrote."""
        if self._open_line:
            self.write("\r\x1b[K")
            self._open_line = False

    def end_line(self) -> None:
        """Keep the line that `line` wrote, and continue below it."""
        if self._open_line:
            self.write("\n")
            self._open_line = False

    def error(self, error: LiteGripError, hint: str, *, is_said: bool = False) -> None:
        """Report an error in one line, and what to do in another, unless the error says it."""
        self.end_line()
        if self.as_json:
            data = {"reason": error.reason, **error.data}
            if hint:
                data.setdefault("hint", hint)
            view = {"code": error.code, "message": error.message, "data": data}
            self.write(f"{json.dumps({'error': view}, ensure_ascii=False)}\n")
        else:
            self.note(error.message)
            if hint and not is_said and hint not in error.message:
                self.warn(f"  {one_line(hint)}\n")

    def note(self, text: str) -> None:
        """Print something that is not a result, on standard error."""
        self.warn(f"litegripctl: {one_line(text)}\n")

    def write(self, text: str) -> None:
        """Write to standard output."""
        write(text)

    def warn(self, text: str) -> None:
        """Write to standard error."""
        sys.stderr.write(text)


class KeptOutput(Output):
    """Keeps what it is to write, for commands that run at the same time."""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__(as_json=as_json)
        self.live = False
        self.written = self.warned = ""

    def write(self, text: str) -> None:
        """Keep what is for standard output."""
        self.written += text

    def warn(self, text: str) -> None:
        """Keep what is for standard error."""
        self.warned += text


def one_line(text: str) -> str:
    """Return one printable line of a text that may come from the daemon."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def may_ask() -> bool:
    """Return True if somebody is there to read a question and to answer it."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def say(text: str) -> None:
    """Show a message before the result."""
    print(text, file=sys.stderr, flush=True)


def ask(question: str) -> str | None:
    """Return the answer in lower case, without the spaces around it; None at the end of input."""
    try:
        sys.stderr.write(f"{question} ")
        sys.stderr.flush()
        line = sys.stdin.readline()
    except KeyboardInterrupt:
        say("")
        raise
    if not line:
        say("")
        return None
    return line.strip().lower()


def confirm(question: str) -> bool:
    """Return True if the answer is yes; everything else is no."""
    return ask(f"{question} [y/N]") in ("y", "yes")


def connected(options: Namespace, timeout_s: float = DEFAULT_TIMEOUT_S) -> Connection:
    """Connect to the daemon that the command line names, and check that it is that one.

    Raises `LiteGripError`. `timeout_s` is the time limit of connecting and of each call.
    """
    if options.only_reads:
        take_the_only(options)
    connection = connect(options.channel, options.socket, timeout_s)
    connection.voice = options.voice
    try:
        hello = connection.greet("litegripctl")
        is_checked = options.channel_chosen and options.socket is None
        if is_checked and hello["channel"] != options.channel:
            hint = "see the variable LITEGRIPD_SOCKET"
            raise different(
                "channel", options.channel, hello["channel"], connection.socket_path, hint
            )
    except BaseException:
        connection.close()
        raise
    return connection


SILENT_AFTER_S = 1.0
"""Later than the next state was due."""


def samples(
    connection: Connection, hz: float
) -> Generator[tuple[dict[str, Any] | None, float], None, None]:
    """Yield each state and 0; None and the seconds since the last one whenever one is overdue.

    Does not end by itself. Raises `ConnectError` when the connection ends, which is closed at the
    end of the generator: nothing is waited for then.
    """
    from litegrip_client.line.feeds import StateFeed  # noqa: PLC0415 - takes long to import

    feed = StateFeed(hz, None, lambda sample: sample.state)
    with connection, connection.subscribe(feed):
        try:
            seen_s = time.monotonic()
            while True:
                try:
                    connection.wait_for(feed, SILENT_AFTER_S + 1.0 / hz)
                except ConnectError as error:
                    if error.reason != "no_answer":
                        raise
                    yield None, time.monotonic() - seen_s
                    continue
                seen_s = time.monotonic()
                yield feed.take(), 0.0
        finally:
            connection.close()  # before the subscription ends, which would ask for that


def take_the_only(options: Namespace) -> None:
    """Take the only daemon that listens to this user where none is named, and say so.

    For commands that move nothing: where one moves, which is meant is not guessed.
    """
    is_named = options.channel_chosen or is_socket_given(options.socket)
    if is_named or DEFAULT_CHANNEL in channels_with_socket():
        return
    running = running_channels()
    if len(running) == 1:
        say(f"{running[0]}, the only daemon that you can reach:")
        options.channel, options.channel_chosen = running[0], True


OK = 0
NOT_OK = 1
WRONG_USAGE = 2
NO_DAEMON = 3
INTERRUPTED = 130

ENDING = ("cancelled", "running")
"""States of a job after its cancelling; one that still runs ends with the next tick."""


class Run:
    """What a command works with; one that needs no daemon gets no connection."""

    __slots__ = ("_connection", "options", "output")

    def __init__(self, connection: Connection | None, options: Namespace, output: Output) -> None:
        self._connection = connection
        self.options = options
        self.output = output

    @property
    def here(self) -> Here:
        """Puts into a text of ours how the same gripper is called again."""
        here: Here = self.options.here
        return here

    @property
    def voice(self) -> Voice:
        """Tells what the daemon says in commands for the same gripper."""
        voice: Voice = self.options.voice
        return voice

    @property
    def connection(self) -> Connection:
        """The connection to the daemon."""
        if self._connection is None:
            raise RuntimeError(f"{self.options.command} is run without a daemon")
        return self._connection

    def done(self, data: Mapping[str, Any], text: str, *, ok: bool = True) -> int:
        """Print a result; return the exit code, by which it is `ok` or not."""
        self.output.result(data, text)
        return OK if ok else NOT_OK

    def refuse(self, text: str, hint: str) -> int:
        """Report wrong usage and what to do; return the exit code."""
        self.output.error(CommandError(text, reason="wrong_usage"), hint)
        return WRONG_USAGE


_OF_DEBIAN = {"rich": "python3-rich", "prometheus_client": "python3-prometheus-client"}
"""Packages for the system's Python; those of this project have the names of its distributions."""


def installing(*libraries: str) -> str:
    """Return the command that installs libraries where this program looks for them."""
    pip = f"{shlex.quote(sys.executable)} -m pip install"
    if is_of_debian():
        is_of_system = sys.prefix == sys.base_prefix
        names = {name: name for name in libraries if name.startswith("litegrip")}
        names.update(_OF_DEBIAN if is_of_system else {})
        if all(name in names for name in libraries):
            return f"sudo apt install {' '.join(names[name] for name in libraries)}"
        pip += " --user --break-system-packages" if is_of_system else ""
    return f"{pip} {' '.join(libraries)}"


Command: TypeAlias = Callable[[Run], int]
"""Carries out one command; returns its exit code."""
Commands: TypeAlias = "Mapping[str, tuple[Command, Fill | None]]"
"""What carries out the commands of a module, by their names, and what adds their arguments."""
