"""How `litegripctl` shows findings: a line for each, and below it what to do.

Findings in, text out; prints nothing itself.
"""

from __future__ import annotations

from collections.abc import Sequence

from litegrip_client.ctl.render import plain
from litegrip_client.doctor.findings import Finding
from litegrip_client.voices import in_shell

_LEVEL_WIDTH = 9
_NAME_WIDTH = 14


def findings_text(findings: Sequence[tuple[str, Finding]]) -> str:
    """Show all findings, and how many are not all right."""
    lines = [line for name, finding in findings for line in _lines(name, finding)]
    counts = [
        _counted(sum(finding.level == level for _, finding in findings), level)
        for level in ("error", "warning")
    ]
    return "\n".join([*lines, "", ", ".join(counts)])


def _lines(name: str, finding: Finding) -> list[str]:
    head = f"{finding.level.upper():<{_LEVEL_WIDTH}}"
    lines = [f"{head}{name:<{_NAME_WIDTH}}{_told(finding.text)}"]
    if finding.command is not None:
        lines.append(f"{'':<{_LEVEL_WIDTH}}{plain(finding.command)}")
    if finding.advice is not None:
        lines.append(f"{'':<{_LEVEL_WIDTH}}({_told(finding.advice)})")
    return lines


def _told(text: str) -> str:
    """Show a text that may be the daemon's, which names methods."""
    return plain(in_shell(text))


def _counted(count: int, level: str) -> str:
    return f"{count} {level}" if count == 1 else f"{count or 'no'} {level}s"
