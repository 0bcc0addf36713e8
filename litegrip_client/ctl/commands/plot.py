"""The command that draws: dumps of the flight recorder, and trajectories.

Only pictures need anything but the standard library, and only when they are drawn.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

from litegrip_client.ctl import files
from litegrip_client.ctl.block_chart import block_chart
from litegrip_client.ctl.commands import is_name
from litegrip_client.ctl.render import plain
from litegrip_client.ctl.render_trajectories import grip_line
from litegrip_client.ctl.run import OK, Command, Run, installing
from litegrip_client.errors import CommandError
from litegrip_client.trajectory import MAGIC, Trajectory

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

_LIBRARIES = ("matplotlib", "mcap")
_WIDEST = 100
_LABELS = 10


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
    files.put(target, picture)
    run.output.result({"path": target}, f"drawn in {plain(target)}")
    return OK


def _trajectory(run: Run) -> Trajectory | None:
    """Return the trajectory that is meant, None for a dump."""
    name, last_s = run.options.file, run.options.last
    if run.options.local:
        trajectory = Trajectory.load(name)
    elif is_name(name):
        from litegrip_client.ctl.commands.trajectory_store import fetched_whole  # noqa: PLC0415

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
        return False  # whoever reads it says why


def _show(run: Run, trajectory: Trajectory | None) -> int:
    """Draw it in the terminal."""
    if trajectory is None:
        raise CommandError(
            f"{run.options.file} is no trajectory, and only these are drawn as text",
            reason="wrong_usage",
            data={"hint": "leave --text out to draw a dump as a picture"},
        )
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
    run.output.result(data, "\n".join([head, *lines, *map(grip_line, trajectory.grips)]))
    return OK


def _picture(run: Run, trajectory: Trajectory | None) -> bytes:
    options = run.options
    try:
        from litegrip_client.ctl.plot.axes import png  # noqa: PLC0415 - needs the extra

        if trajectory is not None:
            from litegrip_client.ctl.plot.trajectory import (  # noqa: PLC0415 - needs the extra
                draw_trajectory,
            )

            return png(draw_trajectory(trajectory, Path(options.file).stem))
        from litegrip_client.ctl.plot.draw import draw  # noqa: PLC0415 - needs the extra
        from litegrip_client.ctl.plot.dump import read  # noqa: PLC0415 - needs the extra
    except ModuleNotFoundError as error:
        raise CommandError(
            f"plot needs the library {error.name}, which is not installed",
            reason="library_missing",
            data={"hint": installing(*_LIBRARIES)},
        ) from error
    return png(draw(read(options.file), options.last))


COMMANDS: Mapping[str, Command] = {"plot": plot}
