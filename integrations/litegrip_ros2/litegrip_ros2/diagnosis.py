"""What `/diagnostics` says of a gripper: a level, a sentence, and figures, all from the daemon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from litegrip_client import GripperState


class Level(IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Diagnosis:
    """One status: `values` are its figures, as texts, by name."""

    level: Level
    message: str
    values: dict[str, str]


_LEVELS = {"ok": Level.OK, "degraded": Level.WARN, "down": Level.ERROR}
"""By the daemon's verdict; one that is not known is an error."""


def of_gripper(
    health: Mapping[str, Any], state: GripperState | None, refused: str = ""
) -> Diagnosis:
    """Return the status of a gripper whose daemon answers; `refused` is the latest refusal."""
    verdict = str(health.get("verdict"))
    level = _LEVELS.get(verdict, Level.ERROR)
    says = [str(reason) for reason in health.get("reasons", ())]
    values = {"verdict": verdict, "notes": "; ".join(map(str, health.get("notes", ())))}
    if state is not None:
        values |= _figures(state)
        concerns = list(_concerns(state))
        says += concerns
        if concerns:
            level = max(level, Level.WARN)
    control, bus = health.get("control") or {}, health.get("bus") or {}
    values["lost ticks"] = _text(control.get("lost_ticks"))
    values["bus load"] = _text(bus.get("load"))
    values["last refusal"] = refused
    return Diagnosis(level, "; ".join(says) or verdict, values)


def of_no_daemon(why: str, refused: str = "") -> Diagnosis:
    """Return the status while no daemon answers."""
    first = why.splitlines()[0] if why else "not connected yet"
    return Diagnosis(Level.ERROR, f"no daemon: {first}", {"last refusal": refused})


def _concerns(state: GripperState) -> list[str]:
    """Return what keeps the gripper from being used, though the daemon is well."""
    says = []
    if state.stop is not None:
        why = state.stop.get("why")
        says.append(f"stopped ({state.stop.get('level')})" + (f": {why}" if why else ""))
    if not state.calibrated:
        says.append("not calibrated")
    if state.stale:
        says.append("the motor does not answer: figures are old")
    return says


def _figures(state: GripperState) -> dict[str, str]:
    job = state.job or {}
    owner = job.get("owner") or {}
    return {
        "bus": state.bus,
        "motor": state.motor,
        "enabled": _text(state.enabled),
        "mode": state.mode,
        "opening (mm)": _text(state.opening_mm),
        "force (N)": _text(state.force_n),
        "object held": _text(state.is_grasped),
        "limited": ", ".join(state.limited),
        "coil (°C)": _text(state.coil_temperature_c),
        "driver (°C)": _text(state.driver_temperature_c),
        "job": _text(job.get("kind")),
        "owner of the job": _text(owner.get("program")),
        "stop": _text((state.stop or {}).get("level")),
    }


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
