"""Parsers that are made when they are used, and what all of them have.

A parser takes half a millisecond to make, and one command is run at a time.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any, NoReturn, TypeAlias

CHANNEL_VARIABLE = "LITEGRIP_CHANNEL"
DEFAULT_CHANNEL = "can0"

Fill: TypeAlias = "Callable[[LateParser], None]"


class UsageError(Exception):
    """The command line is wrong; `usage` says what would be right, the help of `program` more."""

    def __init__(self, message: str, usage: str, program: str) -> None:
        super().__init__(message)
        self.message = message
        self.usage = usage
        self.program = program


class Parser(argparse.ArgumentParser):
    """A parser that leaves it to its caller to say what is wrong.

    `words` names what completes an argument, by its name in the options; see `ctl.completion`.
    """

    def __init__(self, **settings: Any) -> None:
        self.words: dict[str, str] = {"channel": "channels", "socket": "files"}
        super().__init__(
            **settings,
            parents=[common()],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError`."""
        raise UsageError(message, self.format_usage(), self.prog)

    def arguments(self) -> list[argparse.Action]:
        """Return the options and the positional arguments, in their order."""
        return self._actions


class LateParser(Parser):
    """The parser of one command; `fill` adds its arguments as soon as it is to parse some."""

    def __init__(self, *, fill: Fill | None = None, **settings: Any) -> None:
        self._fill = fill
        self._settings = settings

    def become(self) -> None:
        """Become a parser."""
        super().__init__(**self._settings)
        if self._fill is not None:
            self._fill(self)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Become a parser, and parse; note in `help_of` whose help tells of what was given."""
        self.become()
        options, rest = super().parse_known_args(args, namespace)
        if not hasattr(options, "help_of"):  # else an action of this command has noted its own
            options.help_of = self.prog
        return options, rest


def common() -> argparse.ArgumentParser:
    """Give the options that every command takes, in front of its name and behind it."""
    # Without defaults, so that the later place does not undo the earlier.
    parser = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-c",
        "--channel",
        help=f"the daemon's channel (default: ${CHANNEL_VARIABLE}, else {DEFAULT_CHANNEL})",
    )
    where.add_argument("--socket", metavar="PATH", help="the daemon's socket")
    parser.add_argument(
        "--host",
        dest="ssh_host",
        metavar="[USER@]HOST",
        help="the daemon of another machine, reached by ssh; --socket is a path there",
    )
    parser.add_argument("--json", action="store_true", help="print results and errors as JSON")
    return parser
