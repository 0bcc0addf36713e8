"""Names for the events of a picture, few and short enough to be read.

Events that are close together share one label; what is routine gives way to what is not.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from litegrip_client.ctl.plot.dump import Happening

_APART_SHARE = 0.022
"""Two labels are at least this share of the shown time apart."""

_LONGEST = 30
_ALARMS = frozenset({"stop", "object_lost", "heat", "client_lost", "lease_lost"})
_ROUTINE = ("owner", "refused", "lease", "recorder", "job_ended", "calibration")
"""Not named while something else happens close by; the last ones rather than the first."""


@dataclass(frozen=True)
class Label:
    """A text at `x_s`, for what happened at `at_s`; both in seconds before the end."""

    at_s: float
    x_s: float
    text: str
    is_alarm: bool


def labels(events: list[Happening], end_s: float, begin_s: float) -> list[Label]:
    """Return the labels of events in their order of time."""
    apart_s = -begin_s * _APART_SHARE
    groups: list[list[Happening]] = []
    for event in sorted(events, key=lambda event: event.at_s):
        if groups and event.at_s - groups[-1][0].at_s < apart_s:
            groups[-1].append(event)
        else:
            groups.append([event])
    return [_label(group, end_s) for group in groups]


def _label(group: list[Happening], end_s: float) -> Label:
    first = max(group, key=_weight)
    others = len({(event.kind, event.message) for event in group} - {(first.kind, first.message)})
    text = _short(first) + (f"  +{others}" if others else "")
    at_s, x_s = first.at_s - end_s, group[0].at_s - end_s
    return Label(at_s, x_s, text, any(map(_is_alarm, group)))


def _weight(event: Happening) -> int:
    if _is_alarm(event):
        return len(_ROUTINE) + (2 if event.kind == "job_ended" else 3)
    if event.kind in _ROUTINE:
        return _ROUTINE.index(event.kind)
    return len(_ROUTINE) + (event.kind == "job_started")


def _is_alarm(event: Happening) -> bool:
    failed = event.kind == "job_ended" and event.data.get("state") in ("failed", "cancelled")
    fault = event.kind == "motor" and event.data.get("phase") in ("fault", "silent")
    return event.kind in _ALARMS or failed or fault


def _short(event: Happening) -> str:
    """Say it in few words: of a motion its kind, of the motor its new phase."""
    message, data = event.message, event.data
    if event.kind == "job_started" and "kind" in data:
        return f"{data['kind']} (job {data.get('job')})"
    if event.kind == "job_ended" and "state" in data:
        return f"job {data.get('job')} {data['state']}"
    if event.kind == "object_moved" and isinstance(data.get("moved_mm"), int | float):
        return f"object moved {data['moved_mm']:.1f} mm"
    if event.kind == "motor" and "phase" in data:
        return f"motor {data['phase']}"
    if event.kind in ("calibration", "stop", "heat", "recorder", "lease"):
        return event.kind
    words = re.split(r"[:;(]", message)[0].strip()
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 1]}…"
