"""What concerns grippers of other machines: the way to one, and this machine's parts of a fleet.

Facts in, findings out; nothing is asked. The parts' own program, `litegripd-fleet check`, has
examined them: its findings stand among the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from litegrip_client.ctl.doctor.findings import Facts, Finding, Fleet, error, ok, warning

SHORT_S = 30 * 86_400.0
"""A certificate that is good for less is about to be over."""


def protection(facts: Facts) -> Finding | None:
    """Check how the way to another machine's gripper is protected, as its portal says."""
    told = None if facts.daemon is None else facts.daemon.health.get("remote")
    if not isinstance(told, Mapping):
        return None
    if told.get("insecure"):
        return warning(
            "insecure = true in the portal's fleet.toml: nothing is encrypted, and everybody on the"
            " network may do everything",
            advice="make certificates with etc/zenoh-certificates, see docs/fleet.md",
        )
    expires_s = told.get("certificate_expires_s")
    if not isinstance(expires_s, int | float):
        return ok("encrypted")
    days = (expires_s - facts.now_s) / 86_400.0
    if days < 0.0:
        return error("the portal's certificate is over", advice=_RENEW)
    text = f"encrypted; the portal's certificate is good for {days:.0f} days"
    return ok(text) if expires_s - facts.now_s >= SHORT_S else warning(text, advice=_RENEW)


_RENEW = (
    "where the authority's ca.key is: etc/zenoh-certificates DIRECTORY user:NAME; copy it here,"
    " then restart the portal"
)


def of_fleet(facts: Facts) -> list[tuple[str, Finding]]:
    """Return what `litegripd-fleet check` has found, each by its check's name behind `fleet-`."""
    fleet = facts.fleet
    if fleet is None:
        return []
    if fleet.problem is not None:
        text = f"{fleet.file} was not checked: {fleet.problem}"
        return [("fleet", warning(text, advice="run there: litegripd-fleet check"))]
    return [(f"fleet-{name}", finding) for name, finding in fleet.findings]


def read(file: str, told: object) -> Fleet:
    """Read what `litegripd-fleet check --json` has printed; an older one may print anything."""
    rows = told.get("findings") if isinstance(told, Mapping) else None
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        return Fleet(file, problem="litegripd-fleet check has printed something else than findings")
    return Fleet(file, tuple((str(row.get("check")), _finding(row)) for row in rows))


def _finding(row: Mapping[str, Any]) -> Finding:
    command, advice = row.get("command"), row.get("advice")
    level = row.get("level")
    return Finding(
        level if level in ("ok", "warning", "error") else "warning",
        str(row.get("text")),
        None if command is None else str(command),
        None if advice is None else str(advice),
    )
