"""How `litegripctl` shows things to a person: results in, text out.

Takes the wire's objects as they are, so that an older or newer daemon is still shown; prints
nothing itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from time import localtime, strftime

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeAlias

Data: TypeAlias = "Mapping[str, Any]"

_MEASURED = {"opening", "position", "command", "velocity", "torque", "temperature", "status"}
"""Rows that say nothing of a motor that has never answered."""


def figure(value: object, form: str, unit: str) -> str:
    """Show a number with its unit, or `--` when it is not known."""
    shown = format(value, form) if isinstance(value, int | float) else "--"
    return f"{shown} {unit}".rstrip()


def plain(text: object) -> str:
    """Show a text that comes from elsewhere without what could steer a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in str(text))


def state_rows(data: Data) -> list[tuple[str, str]]:
    """Show a state as labels and texts; the texts may hold anything.

    What is measured is left out while the motor has never answered.
    """
    rows = _rows(data)
    if is_unheard(data):
        rows = [(label, text) for label, text in rows if label not in _MEASURED]
    return rows


def is_unheard(data: Data) -> bool:
    """Return True if the motor has never answered: no figure is known, not even an old one."""
    return "feedback_s" in data and data["feedback_s"] is None and data.get("age_s") is None


def _rows(data: Data) -> list[tuple[str, str]]:
    rows = [
        ("mode", f"{data.get('mode')} (motor {data.get('motor')}, bus {data.get('bus')})"),
        ("opening", f"{figure(data.get('opening_mm'), '.2f', 'mm')}, {_openness(data)} open"),
        ("position", figure(data.get("position_rad"), "+.4f", "rad")),
        ("command", _command(data, "command")),
        ("velocity", figure(data.get("velocity_rad_s"), "+.4f", "rad/s")),
        ("torque", _torque(data)),
        ("temperature", _temperature(data)),
        ("status", str(data.get("status"))),
        ("calibrated", f"yes, mount {data.get('mount')}" if data.get("calibrated") else "no"),
        ("age", age(data)),
    ]
    if data.get("force_set_n") is not None:
        rows.append(("squeezing", _squeezing(data)))
    if data.get("limited"):
        rows.append(("limited", ", ".join(map(str, data["limited"]))))
        rows.append(("requested", _command(data, "requested")))
    if data.get("job"):
        rows.append(("job", _job(data["job"])))
    if data.get("stop"):
        rows.append(("stop", _stop(data["stop"])))
    return rows


def age(data: Data) -> str:
    """Show how old a state's feedback is, in capitals when it is too old."""
    seconds = data.get("age_s")
    if is_unheard(data):
        return "no answer yet"
    if data.get("stale"):
        return f"STALE, {figure(seconds, '.1f', 's')} old" if seconds is not None else "STALE"
    return figure(seconds, ".3f", "s")


def lease(data: Data) -> str:
    """Show who has the gripper to itself."""
    holder, waiting = data.get("owner"), data.get("waiting") or 0
    queue = f"; {waiting} waiting" if waiting else ""
    if holder is None:
        return f"free{queue}"
    what = f" for {holder['purpose']}" if holder.get("purpose") else ""
    return plain(f"{owner(holder)}, uid {holder.get('uid')}, has it{what}{queue}")


def owner(data: Data) -> str:
    """Show who owns something."""
    return f"{data.get('program') or data.get('client') or 'unknown'} (pid {data.get('pid')})"


def _openness(data: Data) -> str:
    openness = data.get("openness")
    return f"{openness:.0%}" if isinstance(openness, int | float) else "--"


def _torque(data: Data) -> str:
    torque = figure(data.get("torque_nm"), "+.3f", "N·m")
    return f"{torque}, force about {figure(data.get('force_n'), '+.1f', 'N')}"


def _command(data: Data, name: str) -> str:
    position = figure(data.get(f"{name}_rad"), "+.4f", "rad")
    torque = data.get(f"{name}_torque_nm")
    return position if torque is None else f"{position}, {figure(torque, '+.3f', 'N·m')}"


def _squeezing(data: Data) -> str:
    held = "an object is held" if data.get("is_grasped") else "no object is held"
    clamp_n = data.get("clamp_n")
    felt = ""
    if isinstance(clamp_n, Sequence) and len(clamp_n) == 2:
        low, high = (figure(bound, ".1f", "").rstrip() for bound in clamp_n)
        felt = f" ({low} to {high} N on the object)"
    unnoticed = ""
    if data.get("loss_detection") is False:
        from_n = figure(data.get("loss_detection_from_n"), ".1f", "N")
        unnoticed = f"; its loss would be noticed from {from_n} on"
    return f"with {figure(data['force_set_n'], '.1f', 'N')}{felt}, {held}{unnoticed}"


def _temperature(data: Data) -> str:
    driver = figure(data.get("driver_temperature_c"), ".0f", "°C")
    return f"driver {driver}, coil {figure(data.get('coil_temperature_c'), '.0f', '°C')}"


def _job(job: Data) -> str:
    by = owner(job.get("owner") or {})
    return f"{job.get('job')} {job.get('kind')}, {job.get('phase')}, by {by}"


def _stop(stop: Data) -> str:
    by = stop.get("by")
    who = owner(by) if isinstance(by, Mapping) else by
    why = f": {stop['why']}" if stop.get("why") else ""
    return f"{stop.get('level')}, by {who}{why} (clear it with: litegripctl clear)"


def aligned(table: Sequence[tuple[str, ...]]) -> str:
    """Show rows of cells as a table."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)


def date(unix_s: object) -> str:
    """Show a unix time, as far as it can be one."""
    try:
        return strftime("%Y-%m-%d %H:%M", localtime(float(str(unix_s))))
    except (ValueError, OverflowError, OSError):
        return "--"
