"""How `litegripctl` shows trajectories: recorded, replayed, kept by the daemon or here.

Results in, text out; prints nothing itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from time import localtime, strftime

from litegrip_client.ctl.render import Data, aligned, figure, plain
from litegrip_client.ctl.render_results import bar, opening_of, verdict
from litegrip_client.trajectory import grips_counted

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: dataclasses take long to import
    from litegrip_client.protocol.grips import TaughtGrip


def recording(data: Data, samples: int) -> str:
    """Show how far a recording is, in one line."""
    done = data["samples"] + data["missed"]
    seconds = figure(data.get("duration_s"), ".1f", "s")
    return f"{bar(done / samples)} {seconds}, {data['samples']} samples"


def recorded(data: Data) -> str:
    """Show what was recorded, and how it is called."""
    missed = f", {data['missed']} missed" if data.get("missed") else ""
    length = figure(data.get("duration_s"), ".2f", "s")
    name = plain(data.get("name"))
    grips = f", {grips_counted(data['grips'])}" if data.get("grips") else ""
    text = f"record: {data.get('samples')} samples in {length}{missed}{grips}, kept as {name}"
    return f"{text}; replay it with: litegripctl play {name}"


def played(data: Data) -> str:
    """Show how a replay ended."""
    loops = data.get("loops")
    passes = f"{loops} pass" if loops == 1 else f"{loops} passes"
    behind = figure(data.get("largest_lag_mm"), ".1f", "mm")
    text = f"play: {verdict(data)}, {passes}, at {opening_of(data)}, at most {behind} behind"
    if data.get("grips"):
        width = figure(data.get("width_mm"), ".1f", "mm")
        differs = figure(data.get("width_difference_mm"), "+.1f", "mm")
        grips = grips_counted(data["grips"])
        text += f"; {grips}, the last one {width} wide, at most {differs} to taught"
    return text


def grip_line(grip: TaughtGrip) -> str:
    """Show a grip that is kept with a trajectory."""
    span = f"{grip.start_s:.2f} to {grip.end_s:.2f} s"
    return f"grip: {span}, {grip.force_n:g} N, {grip.width_mm:.1f} mm wide, {plain(grip.source)}"


def listed(rows: Iterable[Data], *, owners: bool = False) -> str:
    """Show trajectories as a table, `owners` by their uid; of one that cannot be used, why."""
    head = ("NAME", "SAMPLES", "LENGTH", "RATE", "MOUNT", "GRIPS", "CREATED")
    table: list[tuple[str, ...]] = [(*head, "UID") if owners else head]
    broken = []
    for row in rows:
        name = plain(row.get("name"))
        if row.get("error") is not None:
            broken.append(f"{name}: NOT usable: {plain(row['error'])}")
        else:
            uid = row.get("uid")
            owner = ("-" if uid is None else str(uid),) if owners else ()
            table.append((name, *_figures(row), *owner))
            if row.get("grip_problem") is not None:
                broken.append(f"{name}: its grips are NOT usable: {plain(row['grip_problem'])}")
    return "\n".join([aligned(table), *broken])


def room(usage: Data | None) -> list[str]:
    """Show how much of the room a user has taken; nothing where the daemon does not say."""
    if usage is None:
        return []
    most, most_mb = usage["most_named"], usage["most_bytes"] / 1e6
    has = f"{usage['named']} of {most}, {usage['bytes'] / 1e6:.1f} of {most_mb:g} MB"
    return [f"of uid {usage['uid']}, who asks: {has}"]


def _figures(row: Data) -> tuple[str, ...]:
    hz = row.get("sample_hz") or 0.0
    return (
        str(row.get("samples") or 0),
        figure(row.get("duration_s"), ".2f", "s"),
        figure(hz, "g", "Hz"),
        plain(row.get("mount") or "-"),
        str(row.get("grips") or "-"),
        date(row.get("created_s")),
    )


def date(unix_s: object) -> str:
    """Show a unix time, as far as it can be one."""
    try:
        return strftime("%Y-%m-%d %H:%M", localtime(float(str(unix_s))))
    except (ValueError, OverflowError, OSError):
        return "--"
