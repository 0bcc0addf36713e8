"""How what the daemon tells is printed: tables, trees, jobs, trajectories and health."""

from __future__ import annotations

from litegrip_client.values.figures import Data, figure, plain

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing these is slow
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from typing import Any


def tree(data: Mapping[str, Any]) -> str:
    """Return nested figures, one in a line, with dotted names."""
    rows = list(leaves(data))
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join(f"{name:<{width}}  {plain(value)}" for name, value in rows)


def leaves(value: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Yield nested figures with dotted names; "--" for what is not there."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from leaves(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from leaves(inner, f"{name}[{index}]")
    else:
        yield name, "--" if value is None or value in ({}, []) else value


def aligned(table: Sequence[tuple[str, ...]]) -> str:
    """Return rows of cells as a table."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)


_HEAD = ("job", "kind", "state", "by", "took", "result")


class _Shown:
    """Shows `str()` at Python's prompt and in a notebook, too."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        printer.text(str(self))


class JobTable(_Shown, list["dict[str, Any]"]):
    """Jobs as the daemon tells them; `str()` is a table of them, a line a job."""

    __slots__ = ()

    def __str__(self) -> str:
        return aligned([_HEAD, *map(_row, self)])


class TrajectoryTable(_Shown, list["dict[str, Any]"]):
    """Trajectories as the daemon tells them; `str()` is a table of them, as the shell shows it."""

    __slots__ = ()

    def __str__(self) -> str:
        return listed_text(self)


class HealthReport(_Shown, dict["str", "Any"]):
    """Health as the daemon tells it; `str()` has the verdict, why, and the figures, in lines."""

    __slots__ = ()

    if not TYPE_CHECKING:  # else a type checker would find every name here

        def __getattr__(self, name):
            """Raise the error; it says how a member is read."""
            how = f": it is a dictionary: health[{name!r}]" if name in self else ""
            text = f"{type(self).__name__!r} object has no attribute {name!r}{how}"
            raise AttributeError(text, name=name)

    def __str__(self) -> str:
        figures = {name: value for name, value in self.items() if name not in _WORDS}
        lines = [f"verdict: {plain(self.get('verdict'))}"]
        lines += [f"- {plain(reason)}" for reason in self.get("reasons", ())]
        lines += [f"note: {plain(note)}" for note in self.get("notes", ())]
        lines += ["", tree(figures)] if figures else []
        return "\n".join(lines)


_WORDS = ("verdict", "reasons", "notes", "terms")
"""Those of health; all others are figures."""


def _row(job: dict[str, Any]) -> tuple[str, ...]:
    owner, began_s, ended_s = job.get("owner") or {}, job.get("started_s"), job.get("ended_s")
    took = "" if began_s is None or ended_s is None else f"{ended_s - began_s:.1f} s"
    error, result = job.get("error") or {}, job.get("result") or {}
    how = error.get("message") or str(result.get("outcome") or "").replace("_", " ")
    by = f"{owner.get('program')} (pid {owner.get('pid')})" if owner else ""
    cells = (job.get("job"), job.get("kind"), job.get("state"), by, took, how)
    return tuple(map(plain, cells))


def listed_text(rows: Iterable[Data], *, owners: bool = False) -> str:
    """Return a table of trajectories, or why one cannot be used; `owners` are names by uid."""
    head = ("NAME", "SAMPLES", "LENGTH", "RATE", "MOUNT", "GRIPS", "CREATED")
    table: list[tuple[str, ...]] = [(*head, "UID") if owners else head]
    broken = []
    for row in rows:
        name = plain(row.get("name"))
        if row.get("error") is not None:
            broken.append(f"{name}: NOT usable: {plain(row['error'])}")
        else:
            uid = row.get("uid")
            owner = ("-" if uid is None else str(uid),) if owners else ()
            table.append((name, *_trajectory_row(row), *owner))
            if row.get("grip_problem") is not None:
                broken.append(f"{name}: its grips are NOT usable: {plain(row['grip_problem'])}")
    return "\n".join([aligned(table), *broken])


def _trajectory_row(row: Data) -> tuple[str, ...]:
    hz = row.get("sample_hz") or 0.0
    return (
        str(row.get("samples") or 0),
        figure(row.get("duration_s"), ".2f", "s"),
        figure(hz, "g", "Hz"),
        plain(row.get("mount") or "-"),
        str(row.get("grips") or "-"),
        date(row.get("created_s")),
    )


def date(unix_s: object) -> str:
    """Return a Unix time as date and time, `--` for what is none."""
    from time import localtime, strftime  # noqa: PLC0415 - see above

    try:
        return strftime("%Y-%m-%d %H:%M", localtime(float(str(unix_s))))
    except (ValueError, OverflowError, OSError):
        return "--"
