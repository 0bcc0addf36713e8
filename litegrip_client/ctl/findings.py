"""Runs checks and shows what they find: `litegripctl doctor` and `litegripd-fleet check`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Generic, Literal, TypeAlias, TypeVar, get_args

from litegrip_client.values.figures import plain

WITHIN_S = 60.0
"""How long a check may take: what it asks has limits of its own, which are shorter."""

Level: TypeAlias = Literal["ok", "warning", "error"]
LEVELS: tuple[Level, ...] = get_args(Level)
FactsT = TypeVar("FactsT")


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check found.

    `command` can be pasted into a shell; `advice` is for what no command does.
    """

    level: Level
    text: str
    command: str | None = None
    advice: str | None = None


Named: TypeAlias = "tuple[str, Finding]"
"""A finding with the name of its check."""
Found: TypeAlias = "Iterable[Named]"


@dataclass(frozen=True)  # with slots, Python 3.10 makes no Check[Facts]()
class Check(Generic[FactsT]):
    """One thing to look at; `examine` gives None where there is nothing to look at.

    It may give several findings, each with a name of its own.
    """

    name: str
    examine: Callable[[FactsT], Finding | Found | None]


def ok(text: str) -> Finding:
    """Return a finding: this is as it should be."""
    return Finding("ok", text)


def warning(text: str, command: str | None = None, advice: str | None = None) -> Finding:
    """Return a finding: this works, but not well, or not always."""
    return Finding("warning", text, command, advice)


def error(text: str, command: str | None = None, advice: str | None = None) -> Finding:
    """Return a finding: with this the gripper cannot be used."""
    return Finding("error", text, command, advice)


def findings_of(
    checks: Iterable[Check[FactsT]], facts: FactsT, within_s: float = WITHIN_S
) -> list[Named]:
    """Run each check on the facts; one that fails, or takes too long, is a finding itself."""
    return [named for check in checks for named in _run(check, facts, within_s)]


def _run(check: Check[FactsT], facts: FactsT, within_s: float) -> list[Named]:
    """Run a check in a thread of its own, which is left alone when its time is up."""
    found: list[Named] = []
    failures = [f"it has not ended within {within_s:g} s"]

    def examine() -> None:
        try:
            examined = check.examine(facts)
            found.extend(
                [(check.name, examined)] if isinstance(examined, Finding) else examined or ()
            )
        except Exception as problem:  # noqa: BLE001 - whatever it is, the other checks are run
            failures[:] = [f"{type(problem).__name__}: {problem}"]
        else:
            failures.clear()

    thread = threading.Thread(target=examine, name=check.name, daemon=True)
    thread.start()
    thread.join(within_s)
    failed = (error(f"this check failed: {why}", advice=_FAILED) for why in failures)
    return [*found, *((check.name, finding) for finding in failed)]


_FAILED = "what it looks at is not known; the other lines hold, and what they name may be why"


def is_well(found: Found) -> bool:
    """Return True unless there is an error."""
    return all(finding.level != "error" for _name, finding in found)


def as_data(found: Sequence[Named], **about: str | None) -> Mapping[str, Any]:
    """Return findings, and what they are `about`, as JSON can hold them."""
    rows = [{"check": name, **asdict(finding)} for name, finding in found]
    return {"ok": is_well(found), **about, "findings": rows}


def read(data: object) -> list[Named] | None:
    """Return findings from such data of any version; None where it is something else."""
    rows = data.get("findings") if isinstance(data, Mapping) else None
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        return None
    return [(str(row.get("check")), _read(row)) for row in rows]


def _read(row: Mapping[str, Any]) -> Finding:
    command, advice = (None if row.get(n) is None else str(row[n]) for n in ("command", "advice"))
    level: Level = next((known for known in LEVELS if known == row.get("level")), "warning")
    return Finding(level, str(row.get("text")), command, advice)


_LEVEL_WIDTH = 9
_NAME_WIDTH = 14


def as_text(found: Sequence[Named]) -> str:
    """Return all findings, and how many are not all right."""
    width = max([_NAME_WIDTH, *(len(name) + 1 for name, _finding in found)])
    lines, below = [], " " * _LEVEL_WIDTH
    for name, finding in found:
        head = f"{finding.level.upper():<{_LEVEL_WIDTH}}"
        lines.append(f"{head}{name:<{width}}{plain(finding.text)}")
        if finding.command is not None:
            lines.append(f"{below}{plain(finding.command)}")
        if finding.advice is not None:
            lines.append(f"{below}({plain(finding.advice)})")
    levels = [finding.level for _name, finding in found]
    errors, warnings = levels.count("error"), levels.count("warning")
    counts = f"{errors or 'no'} error{'' if errors == 1 else 's'}"
    counts += f", {warnings or 'no'} warning{'' if warnings == 1 else 's'}"
    return "\n".join([*lines, "", counts])
