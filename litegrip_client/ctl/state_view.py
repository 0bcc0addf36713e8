"""A state as a person reads it: rows of labels and texts, or one line.

Takes the wire's objects as they are, so that an older or newer daemon is still shown.
"""

from __future__ import annotations

from litegrip_client.core.sockets import NOT_REACHED, is_reached
from litegrip_client.values.figures import Data, Here, figure, owner, plain

_DOUBTS = {
    "superseded": "WRONG: all millimetres are those of earlier versions, which took the travel for"
    " 120 mm; correct them with: litegripctl calibration rescale",
    "unusual": "DOUBTFUL: no gripper with such millimetres was seen; measure the travel again:"
    " litegripctl zero",
}
"""By the doubt of a calibration's scale: what it means, and what to do."""
_MEASURED = {"opening", "position", "command", "velocity", "torque", "temperature", "status"}
"""Rows that say nothing of a motor that has never answered."""


_LABEL_WIDTH = 12


def state_text(data: Data, here: Here) -> str:
    """Return a state in aligned lines."""
    lines = [f"{label:<{_LABEL_WIDTH}} {plain(text)}" for label, text in state_rows(data, here)]
    if is_unheard(data):
        lines.insert(0, "the motor has not answered yet: nothing is known of it")
    elif data.get("stale"):
        lines.insert(0, f"{age(data)}: these are the last known figures")
    return "\n".join(lines)


def state_rows(data: Data, here: Here) -> list[tuple[str, str]]:
    """Return a state as labels and texts; the texts may hold anything.

    What is measured is left out while the motor has never answered.
    """
    doubt, openness = data.get("scale_doubt"), data.get("openness")
    share = f"{openness:.0%}" if isinstance(openness, int | float) else "--"
    torque = figure(data.get("torque_nm"), "+.3f", "N·m")
    driver = figure(data.get("driver_temperature_c"), ".0f", "°C")
    coil = figure(data.get("coil_temperature_c"), ".0f", "°C")
    rows = [
        *([("SCALE", here(_DOUBTS[doubt]) if doubt in _DOUBTS else str(doubt))] if doubt else ()),
        ("mode", f"{data.get('mode')} (motor {data.get('motor')}, bus {data.get('bus')})"),
        ("opening", f"{figure(data.get('opening_mm'), '.2f', 'mm')}, {share} open"),
        ("position", figure(data.get("position_rad"), "+.4f", "rad")),
        ("command", _command(data, "command")),
        ("velocity", figure(data.get("velocity_rad_s"), "+.4f", "rad/s")),
        ("torque", f"{torque}, force about {figure(data.get('force_n'), '+.1f', 'N')}"),
        ("temperature", f"driver {driver}, coil {coil}"),
        ("status", _status(data)),
        ("calibrated", f"yes, mount {data.get('mount')}" if data.get("calibrated") else "no"),
        ("age", age(data)),
    ]
    if data.get("work_stroke_mm") is not None:
        rows.append(("work stroke", f"open goes to {figure(data['work_stroke_mm'], '.2f', 'mm')}"))
    if data.get("force_set_n") is not None:
        rows.append(("squeezing", _squeezing(data)))
    if data.get("pressing_n") is not None:
        rows.append(("pressing", f"with about {figure(data['pressing_n'], '.1f', 'N')}"))
    if data.get("limited"):
        rows.append(("limited", ", ".join(map(str, data["limited"]))))
        rows.append(("requested", _command(data, "requested")))
    if data.get("job"):
        job, by = data["job"], owner(data["job"].get("owner") or {})
        rows.append(("job", f"{job.get('job')} {job.get('kind')}, {job.get('phase')}, by {by}"))
    if data.get("stop"):
        rows.append(("stop", _stop(data["stop"], here)))
    rows += [
        _further(name, value)
        for name, value in data.items()
        if name not in _TOLD and value is not None
    ]
    if is_unheard(data):
        return [(label, text) for label, text in rows if label not in _MEASURED]
    return rows


def is_unheard(data: Data) -> bool:
    """Return True if the motor has never answered: no figure is known, not even an old one."""
    return "feedback_s" in data and data["feedback_s"] is None and data.get("age_s") is None


_TOLD = {
    *("seq", "monotonic_s", "feedback_s", "age_s", "stale", "bus", "motor", "error_code"),
    *("status", "enabled", "mode", "position_rad", "velocity_rad_s", "torque_nm", "force_n"),
    *("opening_mm", "openness", "driver_temperature_c", "coil_temperature_c"),
    *("command_rad", "requested_rad", "command_torque_nm", "requested_torque_nm"),
    *("force_set_n", "is_grasped", "clamp_n", "loss_detection", "loss_detection_from_n"),
    *("pressing_n", "limited", "calibrated", "mount", "work_stroke_mm", "scale_doubt"),
    *("job", "stop", "stop_generation"),
}
"""Fields that rows of their own tell, or that only programs need."""

UNITS = (
    *(("_rad_s", "rad/s"), ("_mm_s", "mm/s"), ("_n_s", "N/s"), ("_rad", "rad"), ("_mm", "mm")),
    *(("_nm", "N·m"), ("_n", "N"), ("_c", "°C"), ("_s", "s")),
)
"""By the end of a field's name: its unit."""


def _further(name: str, value: object) -> tuple[str, str]:
    """Return the row of any other field, such as a newer daemon has, by its name and its unit."""
    suffix, unit = next((one for one in UNITS if name.endswith(one[0])), ("", ""))
    label = name.removesuffix(suffix).replace("_", " ")
    if isinstance(value, bool):
        return label, "yes" if value else "no"
    return label, figure(value, "g", unit) if isinstance(value, int | float) else str(value)


_RESTING = {
    "communication_lost": "normal after a second without commands, enabling clears it",
    "under_voltage": "no supply while unused: see that its 24 V are on before you enable it",
}
"""What a disabled motor takes by itself while nobody uses it."""


def _status(data: Data) -> str:
    status = str(data.get("status"))
    meaning = _RESTING.get(status) if data.get("motor") == "disabled" else None
    return status if meaning is None else f"{status} ({meaning})"


def age(data: Data) -> str:
    """Return how old a state's feedback is, in capitals when it is too old."""
    seconds = data.get("age_s")
    if is_unheard(data):
        return "no answer yet"
    if data.get("stale"):
        return f"STALE, {figure(seconds, '.1f', 's')} old" if seconds is not None else "STALE"
    return figure(seconds, ".3f", "s")


def _command(data: Data, name: str) -> str:
    position = figure(data.get(f"{name}_rad"), "+.4f", "rad")
    torque = data.get(f"{name}_torque_nm")
    return position if torque is None else f"{position}, {figure(torque, '+.3f', 'N·m')}"


def _squeezing(data: Data) -> str:
    if data.get("motor") in ("silent", "unknown"):
        held = "no object was held then, as far as was known"
        if data.get("is_grasped") is None:
            held = (
                "an object was held then; whether it still is, is not known: without power or"
                " commands the motor lets go by itself"
            )
        when = f"{figure(data.get('age_s'), '.1f', 's')} ago, when the motor last answered"
        return f"was with {figure(data['force_set_n'], '.1f', 'N')} {when}; {held}"
    held = "an object is held" if data.get("is_grasped") else "no object is held"
    if data.get("is_grasped") is None:
        held = "the motor is too weak to tell if an object is held"
    clamp_n = data.get("clamp_n")
    felt = ""
    if isinstance(clamp_n, list | tuple) and len(clamp_n) == 2:
        low, high = (figure(bound, ".1f", "").rstrip() for bound in clamp_n)
        felt = f" ({low} to {high} N on the object)"
    unnoticed = ""
    if data.get("loss_detection") is False:
        from_n = figure(data.get("loss_detection_from_n"), ".1f", "N")
        unnoticed = f"; its loss would be noticed from {from_n} on"
    return f"with {figure(data['force_set_n'], '.1f', 'N')}{felt}, {held}{unnoticed}"


def _stop(stop: Data, here: Here) -> str:
    by = stop.get("by")
    who = owner(by) if isinstance(by, dict) else by
    why = f": {stop['why']}" if stop.get("why") else ""
    clear = here("clear it with: litegripctl clear")
    return f"{stop.get('level')}, by {who}{why} ({clear})"


def state_line(data: Data, here: Here) -> str:
    """Return a state in one line."""
    parts = [
        f"{data.get('mode')!s:<9}",
        f"{figure(data.get('opening_mm'), '7.2f', 'mm'):>10}",
        f"{figure(data.get('position_rad'), '+.4f', 'rad'):>12}",
        f"{figure(data.get('torque_nm'), '+.3f', 'N·m'):>11}",
        f"{figure(data.get('coil_temperature_c'), '.0f', '°C'):>6}",
    ]
    if data.get("job"):
        job = data["job"]
        phase = f" {job.get('phase')}" if job.get("kind") == "teleop" and job.get("phase") else ""
        parts.append(f"job {job.get('job')} {job.get('kind')}{phase}")
    if data.get("stop"):
        parts.append(f"STOP {data['stop'].get('level')}")
    if data.get("pressing_n") is not None:
        parts.append(f"pressing {figure(data['pressing_n'], '.1f', 'N')}")
    if data.get("scale_doubt"):
        parts.append(f"SCALE {data['scale_doubt']}, {here('see: litegripctl state')}")
    if data.get("stale") or is_unheard(data):
        parts.append(age(data))
    return plain("  ".join(parts))


def stopped(data: Data, here: Here) -> str:
    """Return the text for a latched stop, and what it cannot reach."""
    until = here("until: litegripctl clear")
    if not is_reached(data):
        return plain(f"{data['level']} is latched, {until}; but {NOT_REACHED}")
    text = plain(f"stopped: {data['level']}, {until}")
    if data["level"] == "hold" and data.get("motor", "enabled") == "enabled":
        text += here("\nwhat is squeezed stays so; to let go: litegripctl stop --level relax")
    return text
