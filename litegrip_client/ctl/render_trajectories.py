"""How `litegripctl` shows trajectories: recorded, replayed, kept by the daemon or here.

Results in, text out; prints nothing itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from time import localtime, strftime

from litegrip_client.ctl.render import Data, aligned, figure, plain
from litegrip_client.ctl.render_results import bar, opening_of, verdict


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
    text = f"record: {data.get('samples')} samples in {length}{missed}, kept as {name}"
    return f"{text}; replay it with: litegripctl play {name}"


def played(data: Data) -> str:
    """Show how a replay ended."""
    loops = data.get("loops")
    passes = f"{loops} pass" if loops == 1 else f"{loops} passes"
    behind = figure(data.get("largest_lag_mm"), ".1f", "mm")
    return f"play: {verdict(data)}, {passes}, at {opening_of(data)}, at most {behind} behind"


def listed(rows: Iterable[Data]) -> str:
    """Show trajectories as a table; of one that cannot be used, why."""
    table: list[tuple[str, ...]] = [("NAME", "SAMPLES", "LENGTH", "RATE", "MOUNT", "CREATED")]
    broken = []
    for row in rows:
        name = plain(row.get("name"))
        if row.get("error") is not None:
            broken.append(f"{name}: NOT usable: {plain(row['error'])}")
        else:
            table.append((name, *_figures(row)))
    return "\n".join([aligned(table), *broken])


def _figures(row: Data) -> tuple[str, ...]:
    samples, hz = row.get("samples") or 0, row.get("sample_hz") or 0.0
    length_s = max(samples - 1, 0) / hz if hz > 0.0 else None
    return (
        str(samples),
        figure(length_s, ".2f", "s"),
        figure(hz, "g", "Hz"),
        plain(row.get("mount") or "-"),
        date(row.get("created_s")),
    )


def date(unix_s: object) -> str:
    """Show a unix time, as far as it can be one."""
    try:
        return strftime("%Y-%m-%d %H:%M", localtime(float(str(unix_s))))
    except (ValueError, OverflowError, OSError):
        return "--"
