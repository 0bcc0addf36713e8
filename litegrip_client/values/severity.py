"""Which events are warnings: declared once for journal, dumps, the page and live viewers."""

from __future__ import annotations

from collections.abc import Mapping

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Literal

SEVERITIES: Mapping[str, Literal["info", "warning"]] = {
    "job_started": "info",
    "job_ended": "info",
    "stop": "warning",
    "stop_cleared": "info",
    "bus": "info",
    "motor": "info",
    "second_master": "warning",
    "implausible": "warning",
    "client_lost": "warning",
    "object_lost": "warning",
    "object_moved": "info",
    "released_by_fault": "warning",
    "weak": "info",
    "pressing": "warning",
    "swing": "warning",
    "heat": "warning",
    "calibration": "info",
    "lease": "info",
    "lease_lost": "warning",
    "recorder": "info",
    "refused": "warning",
    "teleop": "info",
}
"""What an event of each kind is, unless its data says more (`is_warning`). A warning is what the
jaws or the motor do, or a client has to bear, without having asked for it."""

WARNINGS = frozenset[str](kind for kind, severity in SEVERITIES.items() if severity == "warning")

WARNING_MEMBERS = ("error", "warning")
"""The members of an event's data of which each makes it a warning, whatever its kind."""
EXCUSE = "at_rest"
"""The member by which it is none: nobody uses what does not answer."""


def is_warning(kind: str, data: Mapping[str, object]) -> bool:
    """Return True for an event that the journal, dumps, the page and viewers show as a warning."""
    by_kind = kind in WARNINGS
    return not data.get(EXCUSE) and (by_kind or any(data.get(key) for key in WARNING_MEMBERS))
