"""Rows of cells as a table, and jobs as one."""

from __future__ import annotations

from collections.abc import Sequence

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


def aligned(table: Sequence[tuple[str, ...]]) -> str:
    """Return rows of cells as a table."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)


_HEAD = ("job", "kind", "state", "by", "took", "result")


class JobTable(list["dict[str, Any]"]):
    """Jobs as the daemon tells them; `str()` is a table of them, a line a job."""

    __slots__ = ()

    def __str__(self) -> str:
        return aligned([_HEAD, *map(_row, self)])

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        """Show the table in a notebook, too."""
        printer.text(str(self))


def _row(job: dict[str, Any]) -> tuple[str, ...]:
    owner, began_s, ended_s = job.get("owner") or {}, job.get("started_s"), job.get("ended_s")
    took = "" if began_s is None or ended_s is None else f"{ended_s - began_s:.1f} s"
    error, result = job.get("error") or {}, job.get("result") or {}
    how = error.get("message") or str(result.get("outcome") or "").replace("_", " ")
    by = f"{owner.get('program')} (pid {owner.get('pid')})" if owner else ""
    return (str(job.get("job")), str(job.get("kind")), str(job.get("state")), by, took, how)
