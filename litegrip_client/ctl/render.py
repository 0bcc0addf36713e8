"""How `litegripctl` shows things to a person: results in, text out.

Takes the wire's objects as they are, so that an older or newer daemon is still shown; prints
nothing itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from time import localtime, strftime

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeAlias

Data: TypeAlias = "Mapping[str, Any]"


def figure(value: object, form: str, unit: str) -> str:
    """Show a number with its unit, or `--` when it is not known."""
    shown = format(value, form) if isinstance(value, int | float) else "--"
    return f"{shown} {unit}".rstrip()


def plain(text: object) -> str:
    """Show a text that comes from elsewhere without what could steer a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in str(text))


def lease(data: Data) -> str:
    """Show who has the gripper to itself."""
    holder, waiting = data.get("owner"), data.get("waiting") or 0
    queue = f"; {waiting} waiting" if waiting else ""
    if holder is None:
        return f"free{queue}"
    what = f" for {holder['purpose']}" if holder.get("purpose") else ""
    return plain(f"{owner(holder)}, uid {holder.get('uid')}, has it{what}{queue}")


def owner(data: Data) -> str:
    """Show who owns something."""
    return f"{data.get('program') or data.get('client') or 'unknown'} (pid {data.get('pid')})"


def aligned(table: Sequence[tuple[str, ...]]) -> str:
    """Show rows of cells as a table."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)


def date(unix_s: object) -> str:
    """Show a unix time, as far as it can be one."""
    try:
        return strftime("%Y-%m-%d %H:%M", localtime(float(str(unix_s))))
    except (ValueError, OverflowError, OSError):
        return "--"
