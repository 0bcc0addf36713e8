"""How `litegripctl` shows how things ended: motions, calibrations, settings.

Results in, text out; prints nothing itself.
"""

from __future__ import annotations

from collections.abc import Iterable

from litegrip_client.ctl.hints import CHOOSE_MOUNT
from litegrip_client.ctl.render import Data, figure, plain
from litegrip_client.voices import in_shell

TEMPLATES = ("normal", "reverse")

_BAR_WIDTH = 24
_IN_USE = "in use until the daemon restarts"
_MEASURE = (
    "nominal: it was not measured on this gripper; measure and store it with:"
    " litegripctl enable && litegripctl zero"
)


def progress(data: Data) -> str:
    """Show how far a motion is, in one line; with a bar where it is known how far it goes."""
    total = data.get("total_steps") or 0
    done = f"{bar(data.get('step', 0) / total)} " if total > 0 else ""
    opening = figure(data.get("opening_mm"), "6.2f", "mm")
    torque = figure(data.get("torque_nm"), "+.2f", "N·m")
    passes = f", pass {data['loops'] + 1}" if data.get("loops") else ""
    return f"{done}{opening}  {torque}  {words(data.get('phase'))}{passes}"


def bar(share: float) -> str:
    """Show a share, 0 to 1, as a bar."""
    filled = "#" * round(min(1.0, max(0.0, share)) * _BAR_WIDTH)
    return f"[{filled.ljust(_BAR_WIDTH, '.')}]"


def move(name: str, data: Data) -> str:
    """Show how a motion ended."""
    return f"{name}: {verdict(data)}, at {opening_of(data)}"


def grasp(data: Data) -> str:
    """Show whether something is held, how wide it is, and how to let go of it."""
    width = data.get("width_mm")
    text = f"grasp: {verdict(data)}, "
    text += f"at {opening_of(data)}" if width is None else f"{figure(width, '.1f', 'mm')} wide"
    if data.get("held_s"):
        text += f", held for {figure(data['held_s'], '.1f', 's')}"
    if data.get("ok") or data.get("state", {}).get("force_set_n") is not None:
        text += f", holding {figure(data.get('force_n'), '.1f', 'N')}"
        text += "; let go with: litegripctl release"
    return text


def force(data: Data) -> str:
    """Show with which force the jaws squeeze from now on."""
    newtons = figure(data.get("force_n"), ".1f", "N")
    return (
        f"force: squeezing with {newtons}, at {opening_of(data)}; let go with: litegripctl release"
    )


def measured(name: str, data: Data) -> str:
    """Show what was measured between the stops, and whether it is stored."""
    text = f"{name}: {verdict(data)}"
    if data.get("message"):
        text += f": {plain(in_shell(str(data['message'])))}"
    if data.get("closed_rad") is not None and data.get("open_rad") is not None:
        text += f"\n{travel(data)}"
    if data.get("path") is not None:
        return f"{text}\nstored in {plain(data['path'])}"
    return f"{text}\n{_unstored()}" if data.get("ok") else text


def travel(data: Data) -> str:
    """Show the two stops and what lies between, in one line."""
    closed_rad, open_rad = data["closed_rad"], data["open_rad"]
    travel_rad = abs(closed_rad - open_rad)
    mount = "normal" if closed_rad > open_rad else "reverse"
    size = figure(travel_rad, ".4f", "rad")
    if data.get("rad_to_mm") is not None:
        size += f" or {figure(travel_rad * data['rad_to_mm'], '.2f', 'mm')}"
    ends = f"closed {figure(closed_rad, '+.4f', 'rad')}, open {figure(open_rad, '+.4f', 'rad')}"
    return f"{ends}, travel {size}, mount {mount}"


def calibration(data: Data) -> str:
    """Show the calibration in use in aligned lines."""
    if not data.get("calibrated"):
        return f"not calibrated; {CHOOSE_MOUNT}"
    rows = [
        ("mount", data.get("mount")),
        ("closed", figure(data.get("closed_rad"), "+.4f", "rad")),
        ("open", figure(data.get("open_rad"), "+.4f", "rad")),
        ("travel", _travel(data)),
        ("scale", figure(data.get("rad_to_mm"), ".2f", "mm/rad")),
        ("gains", f"kp {figure(data.get('kp'), 'g', '')}, kd {figure(data.get('kd'), 'g', '')}"),
        ("file", data.get("file") or "none"),
    ]
    return "\n".join(f"{label:<7} {plain(text)}" for label, text in rows)


def templates(rows: Iterable[Data]) -> str:
    """Show the templates, one in a line."""
    return "\n".join(
        f"{plain(row.get('name')):<8} closed "
        f"{figure(row['content'].get('zero_position_rad'), '+.4f', 'rad')}, "
        f"open {figure(row['content'].get('max_position_rad'), '+.4f', 'rad')}"
        for row in rows
    )


def loaded(data: Data, *, source: str | None) -> str:
    """Show what was loaded, what was not and why, and whether it is stored.

    Without a `source` the daemon has found it itself, and will do so again. A template is no
    measurement: what is to be done next is to measure.
    """
    lines = [f"skipped: {plain(reason)}" for reason in data.get("skipped") or ()]
    if not data.get("loaded"):
        lines += ["NOT loaded: no calibration was found", CHOOSE_MOUNT]
    else:
        lines.append(f"loaded: mount {plain(data.get('mount'))}, travel {_travel(data)}")
        saved = data.get("saved")
        if saved is not None:
            lines.append(stored(saved))
        elif source is None:
            lines.append(f"found in {plain(data.get('file'))}")
        else:
            lines.append(_IN_USE if source in TEMPLATES else _unstored())
        if source in TEMPLATES:
            lines.append(_MEASURE)
    return "\n".join(lines)


def stored(data: Data) -> str:
    """Show where the calibration was stored."""
    previous = data.get("previous")
    before = f" (the one before: {plain(previous)})" if previous else ""
    return f"stored in {plain(data.get('path'))}{before}"


def config(data: Data) -> str:
    """Show fields, their values and what is allowed, one in a line."""
    fields = data["config"]
    names = max(map(len, fields), default=0)
    values = max((len(plain(value)) for value in fields.values()), default=0)
    lines = []
    for name, value in fields.items():
        allowed = data.get("ranges", {}).get(name)
        limits = f"  {allowed[0]:g} to {allowed[1]:g}" if allowed else ""
        lines.append(f"{plain(name):<{names}}  {plain(value):<{values}}{limits}".rstrip())
    return "\n".join(lines)


def registers(rows: Iterable[Data]) -> str:
    """Show registers, one in a line."""
    return "\n".join(
        f"{plain(row.get('number')):>3}  {plain(row.get('name')):<9}  {plain(row.get('value'))}"
        for row in rows
    )


def verdict(data: Data) -> str:
    """Show whether it went as it should, and how it ended."""
    return f"{'' if data.get('ok') else 'NOT ok: '}{words(data.get('outcome'))}"


def words(name: object) -> str:
    """Show a name of the protocol in words."""
    return plain(name).replace("_", " ")


def opening_of(data: Data) -> str:
    """Show where the jaws were at the end."""
    return figure(data.get("state", {}).get("opening_mm"), ".2f", "mm")


def _travel(data: Data) -> str:
    size = figure(data.get("travel_rad"), ".4f", "rad")
    return f"{size} or {figure(data.get('travel_mm'), '.2f', 'mm')}"


def _unstored() -> str:
    return f"{_IN_USE}; store it with: litegripctl calibration save"
