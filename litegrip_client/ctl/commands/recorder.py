"""The flight recorder: its dumps are written and drawn, and so are trajectories.

Only pictures need anything but the standard library, and only when they are drawn.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.commands import is_name
from litegrip_client.ctl.commands.trajectories import fetched_whole
from litegrip_client.ctl.figures import figure, plain
from litegrip_client.ctl.files import put_file, refuse_existing
from litegrip_client.ctl.parser import LateParser, positive
from litegrip_client.ctl.run import OK, Commands, Run, installing
from litegrip_client.values.errors import CommandError
from litegrip_client.values.trajectory import Trajectory
from litegrip_client.values.trajectory_format import MAGIC

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from types import ModuleType
    from typing import Any

    from litegrip_client.values.trajectory_format import TaughtGrip


_EIGHTHS = " ▁▂▃▄▅▆▇█"


def block_chart(
    points: Sequence[tuple[float, float]],
    *,
    top: float,
    unit: str,
    width: int = 72,
    height: int = 10,
    spans: Sequence[tuple[float, float]] = (),
    span_label: str = "",
) -> list[str]:
    """Return the lines of a chart, `width` columns wide besides its labels.

    `points` are times in s, which never run backwards, and values of 0 to `top`; what is outside
    is drawn at the edge. A column shows the value at its middle, on the line between the points.
    `spans`, from when to when, are marked below, each in one column at least.
    """
    labels = [f"{share * top:.0f} {unit}" for share in (1.0, 0.5, 0.0)]
    margin = max(map(len, labels))
    levels = [round(_share(value, top) * height * 8) for value in _resampled(points, width)]
    lines = []
    for row in range(height):
        below = (height - 1 - row) * 8
        label = {0: labels[0], height // 2: labels[1], height - 1: labels[2]}.get(row, "")
        blocks = "".join(_EIGHTHS[min(max(level - below, 0), 8)] for level in levels)
        lines.append(f"{label:>{margin}} ┤{blocks}".rstrip())
    first, last = (f"{points[end][0]:.2f} s" for end in (0, -1))
    lines.append(f"{'':>{margin}} └{'─' * width}")
    if spans:
        lines.append(f"{span_label:>{margin}}  {_marks(points, spans, width)}".rstrip())
    lines.append(f"{'':>{margin}}  {first}{last:>{max(width - len(first), len(last) + 1)}}")
    return lines


def _share(value: float, top: float) -> float:
    return min(max(value / top, 0.0), 1.0)


def _marks(
    points: Sequence[tuple[float, float]], spans: Sequence[tuple[float, float]], width: int
) -> str:
    begin_s, span_s = points[0][0], points[-1][0] - points[0][0]
    marks = [" "] * width
    for from_s, to_s in spans:
        first, last = (
            min(int(width * (at_s - begin_s) / span_s), width - 1) if span_s > 0.0 else 0
            for at_s in (from_s, to_s)
        )
        marks[first : last + 1] = "━" * (last + 1 - first)
    return "".join(marks)


def _resampled(points: Sequence[tuple[float, float]], width: int) -> list[float]:
    begin_s, span_s = points[0][0], points[-1][0] - points[0][0]
    values, at = [], 0
    for column in range(width):
        time_s = begin_s + span_s * (column + 0.5) / width
        while at + 1 < len(points) and points[at + 1][0] <= time_s:
            at += 1
        (here_s, here), (next_s, after) = points[at], points[min(at + 1, len(points) - 1)]
        share = (time_s - here_s) / (next_s - here_s) if next_s > here_s else 0.0
        values.append(here + (after - here) * share)
    return values


_DUMP = """\
Have the daemon write its flight recorder: the last minute, tick by tick, with
all events, as an MCAP file on the daemon's machine. It does so by itself when
the motor faults, when an enabled motor falls silent, is disabled by nobody here
or loses its bus, when its position jumps, when a second master begins to
command it, and when a tick fails.
"""


def dump_options(parser: LateParser) -> None:
    """Add the arguments of `dump`."""
    parser.description = _DUMP
    parser.add_argument("--note", metavar="TEXT", help="kept in the file: why it was asked for")
    parser.add_argument("-o", "--output", metavar="FILE", help="copy it to this file, here")


def dump(run: Run) -> int:
    """Have the recorder written; copy the file where that is wanted."""
    target, note = run.options.output, run.options.note
    if target is not None:
        refuse_existing(target, "take another name")
    params = {} if note is None else {"note": note}
    data = run.connection.call("recorder.dump", params, ACTION_TIMEOUT_S)
    path = data["path"]
    if target is not None:
        put_file(target, _content(path))
        path, data = target, {**data, "file": target}
    size = figure(data["bytes"] / 1e6, ".1f", "MB")
    length = figure(data["seconds"], ".0f", "s")
    run.output.result(data, f"{length} ({data['ticks']} ticks, {size}) in {plain(path)}")
    return OK


def _content(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise CommandError(
            f"the dump is {path} on the daemon's machine, but cannot be read from here: "
            f"{error.strerror}",
            reason="file_not_read",
            data={"hint": "copy it there, as a user who may read it", "path": path},
        ) from error


_LIBRARIES = ("matplotlib", "mcap")
_WIDEST = 100
_LABELS = 10


_PLOT = """\
Draw a dump of the flight recorder: opening, torque, temperatures and lateness
over time, with what happened; or a trajectory. What is no file here, and has
neither a path nor an ending, is a trajectory that the daemon keeps. Pictures
need matplotlib and mcap: pip install matplotlib mcap
"""


def plot_options(parser: LateParser) -> None:
    """Add the arguments of `plot`."""
    parser.description = _PLOT
    parser.add_argument("file", metavar="FILE|NAME", help="a dump, or a trajectory")
    parser.add_argument("--local", action="store_true", help="a trajectory of this user's")
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "-o", "--output", metavar="PNG", help="the picture (default: beside FILE, as .png)"
    )
    how.add_argument(
        "--text", action="store_true", help="a quick look at the opening, here in the terminal"
    )
    parser.add_argument("--last", type=positive, metavar="S", help="only the last S seconds of it")


def plot(run: Run) -> int:
    """Draw a dump or a trajectory."""
    options = run.options
    trajectory = _trajectory(run)
    if options.text:
        return _show(run, trajectory)
    picture = _picture(run, trajectory)
    here = Path(options.file) if trajectory is None or not options.local else None
    target = options.output or f"{Path(options.file).stem}.png"
    if here is not None and not options.output:
        target = str(here.with_suffix(".png"))
    put_file(target, picture)
    run.output.result({"path": target}, f"drawn in {plain(target)}")
    return OK


def _trajectory(run: Run) -> Trajectory | None:
    """Return the trajectory that is meant, None for a dump."""
    name, last_s = run.options.file, run.options.last
    if run.options.local:
        trajectory = Trajectory.load(name)
    elif is_name(name):
        trajectory = fetched_whole(run, {"name": name})[0]
    elif Path(name).suffix == ".lgt" or _begins_as_one(name):
        trajectory = Trajectory.load(Path(name).absolute())
    else:
        return None
    if not trajectory.samples:
        raise CommandError(f"{name} has no samples to draw", reason="trajectory_unreadable")
    if last_s is None:
        return trajectory
    begin_s = trajectory.samples[-1].t - last_s
    return _since(trajectory, begin_s)


def _since(trajectory: Trajectory, begin_s: float) -> Trajectory:
    """Return the later part; of a grip under way then what is left of it."""
    samples = [one for one in trajectory.samples if one.t >= begin_s]
    first_s = samples[0].t
    grips = [
        replace(grip, closing_s=max(grip.closing_s, first_s), start_s=max(grip.start_s, first_s))
        for grip in trajectory.grips
        if grip.end_s >= first_s
    ]
    return replace(trajectory, samples=samples, grips=grips)


def _begins_as_one(path: str) -> bool:
    try:
        with Path(path).open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # its reader says why


def _show(run: Run, trajectory: Trajectory | None) -> int:
    """Draw it in the terminal."""
    if trajectory is None:
        return _show_dump(run)
    travel_mm = trajectory.travel_mm
    lines = block_chart(
        [(one.t, one.openness * travel_mm) for one in trajectory.samples],
        top=travel_mm,
        unit="mm",
        width=max(20, min(_WIDEST, shutil.get_terminal_size().columns) - _LABELS),
        spans=[(grip.start_s, grip.end_s) for grip in trajectory.grips],
        span_label="grip",
    )
    mount = f", mount {trajectory.mount}" if trajectory.mount else ""
    head = f"{len(trajectory)} samples, {trajectory.duration_s:.2f} s{mount}"
    data: dict[str, Any] = {
        "samples": len(trajectory),
        "duration_s": trajectory.duration_s,
        "mount": trajectory.mount,
        "travel_mm": travel_mm,
        "grips": [asdict(grip) for grip in trajectory.grips],
        "lines": lines,
    }
    run.output.result(data, "\n".join([head, *lines, *map(_grip_line, trajectory.grips)]))
    return OK


def _show_dump(run: Run) -> int:
    """Draw the opening of a dump in the terminal, and list what happened."""
    dump = _drawing().read(run.options.file)
    end_s = dump.ticks[-1]["monotonic_s"]
    from_s = -math.inf if run.options.last is None else -run.options.last
    points = [
        (tick["monotonic_s"] - end_s, tick["opening_mm"])
        for tick in dump.ticks
        if "opening_mm" in tick and tick["monotonic_s"] - end_s >= from_s
    ]
    lines = ["the opening was not known"]
    if points:
        width = max(20, min(_WIDEST, shutil.get_terminal_size().columns) - _LABELS)
        top_mm = max(1.0, *(value for _, value in points))
        lines = block_chart(points, top=top_mm, unit="mm", width=width)
    events = [
        {"time_s": event.at_s - end_s, "kind": event.kind, "message": event.message}
        for event in dump.events
        if event.at_s - end_s >= from_s
    ]
    head = f"{len(dump.ticks)} ticks; 0 s is the end"
    happened = [f"{event['time_s']:8.2f} s  {plain(event['message'])}" for event in events]
    data = {"ticks": len(dump.ticks), "lines": lines, "events": events}
    run.output.result(data, "\n".join([head, *lines, *happened]))
    return OK


def _grip_line(grip: TaughtGrip) -> str:
    """Return a grip that is kept with a trajectory."""
    span = f"{grip.start_s:.2f} to {grip.end_s:.2f} s"
    return f"grip: {span}, {grip.force_n:g} N, {grip.width_mm:.1f} mm wide, {plain(grip.source)}"


def _picture(run: Run, trajectory: Trajectory | None) -> bytes:
    options, drawing = run.options, _drawing()
    if trajectory is not None:
        figure = drawing.draw_trajectory(trajectory, Path(options.file).stem)
    else:
        figure = drawing.draw(drawing.read(options.file), options.last)
    picture: bytes = drawing.png(figure)
    return picture


def _drawing() -> ModuleType:
    """Return what reads dumps and draws; raises `CommandError` without its libraries."""
    try:
        from litegrip_client.ctl.plot import drawing  # noqa: PLC0415 - needs the extra
    except ModuleNotFoundError as error:
        raise CommandError(
            f"plot needs the library {error.name}, which is not installed",
            reason="library_missing",
            data={"hint": installing(*_LIBRARIES)},
        ) from error
    return drawing


COMMANDS: Commands = {
    "dump": (dump, dump_options),
    "plot": (plot, plot_options),
}
