"""Figures and foreign texts, as a person reads them."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # see core/sockets
    from collections.abc import Callable, Mapping
    from typing import Any, TypeAlias

LIST_SERIAL = "ls -l /dev/serial/by-id/"
"""Lists the serial adapters, by names that last."""

PROGRAM = "litegripctl"

Data: TypeAlias = "Mapping[str, Any]"

Here: TypeAlias = "Callable[[str], str]"
"""Puts into a text of ours how litegripctl is called for this gripper: `-c left`, say.

Only what this program says itself goes through it: in what others say, nothing is replaced.
"""


def figure(value: object, form: str, unit: str) -> str:
    """Return a number with its unit, `--` if it is not known."""
    shown = format(value, form) if isinstance(value, int | float) else "--"
    if shown.startswith("-0") and not shown.strip("-0."):
        shown = f"{'+' if form.startswith('+') else ''}{shown[1:]}"  # no zero below zero
    return f"{shown} {unit}".rstrip()


def plain(text: object) -> str:
    """Return a foreign text without the characters that could control a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in str(text))


def owner(data: Data) -> str:
    """Return the program and the pid of an owner."""
    return f"{data.get('program') or data.get('client') or 'unknown'} (pid {data.get('pid')})"
