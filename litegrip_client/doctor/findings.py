"""What a check finds: a level, one line, and what to do where it is not all right."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from litegrip_client.doctor.facts import Facts

Level: TypeAlias = Literal["ok", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check found.

    `command` can be pasted into a shell; `advice` is for what no command does.
    """

    level: Level
    text: str
    command: str | None = None
    advice: str | None = None


@dataclass(frozen=True, slots=True)
class Check:
    """One thing to look at; `examine` gives None where there is nothing to look at."""

    name: str
    examine: Callable[[Facts], Finding | None]


def ok(text: str) -> Finding:
    """Find that something is as it should be."""
    return Finding("ok", text)


def warning(text: str, command: str | None = None, advice: str | None = None) -> Finding:
    """Find something that works, but not well, or not always."""
    return Finding("warning", text, command, advice)


def error(text: str, command: str | None = None, advice: str | None = None) -> Finding:
    """Find something with which the gripper cannot be used."""
    return Finding("error", text, command, advice)


def examine(facts: Facts, checks: Iterable[Check]) -> list[tuple[str, Finding]]:
    """Let every check look at the facts; return what was found, by the check's name."""
    found = ((check.name, check.examine(facts)) for check in checks)
    return [(name, finding) for name, finding in found if finding is not None]


def as_data(channel: str | None, findings: Iterable[tuple[str, Finding]]) -> Mapping[str, Any]:
    """Return findings as JSON can hold them; `ok` unless there is an error.

    `channel` is None where it is not known.
    """
    rows = [
        {
            "check": name,
            "level": finding.level,
            "text": finding.text,
            "command": finding.command,
            "advice": finding.advice,
        }
        for name, finding in findings
    ]
    return {
        "ok": all(row["level"] != "error" for row in rows),
        "channel": channel,
        "findings": rows,
    }
