"""Parsers that are made when they are used, and what all of them have.

A parser takes half a millisecond to make, and one command is run at a time.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any, TypeAlias

CHANNEL_VARIABLE = "LITEGRIP_CHANNEL"
DEFAULT_CHANNEL = "can0"

Fill: TypeAlias = "Callable[[LateParser], None]"


class LateParser(argparse.ArgumentParser):
    """The parser of one command; `fill` adds its arguments as soon as it is to parse some."""

    def __init__(self, *, fill: Fill | None = None, **settings: Any) -> None:
        self._fill = fill
        self._settings = settings

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Become a parser, and parse."""
        super().__init__(
            **self._settings,
            parents=[common()],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if self._fill is not None:
            self._fill(self)
        return super().parse_known_args(args, namespace)


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
    parser.add_argument("--json", action="store_true", help="print results and errors as JSON")
    return parser
