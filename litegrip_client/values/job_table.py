"""Jobs as a list that prints as a table."""

from __future__ import annotations

from typing import Any

_HEAD = ("job", "kind", "state", "by", "took", "result")


class JobTable(list[dict[str, Any]]):
    """Jobs as the daemon tells them; `str()` is a table of them, a line a job."""

    __slots__ = ()

    def __str__(self) -> str:
        rows = [_HEAD, *map(_row, self)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = (
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            for row in rows
        )
        return "\n".join(line.rstrip() for line in lines)


def _row(job: dict[str, Any]) -> tuple[str, ...]:
    owner, began_s, ended_s = job.get("owner") or {}, job.get("started_s"), job.get("ended_s")
    took = "" if began_s is None or ended_s is None else f"{ended_s - began_s:.1f} s"
    error, result = job.get("error") or {}, job.get("result") or {}
    how = error.get("message") or str(result.get("outcome") or "").replace("_", " ")
    by = f"{owner.get('program')} (pid {owner.get('pid')})" if owner else ""
    return (str(job.get("job")), str(job.get("kind")), str(job.get("state")), by, took, how)
