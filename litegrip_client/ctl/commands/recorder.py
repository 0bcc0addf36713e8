"""The flight recorder: its dumps are written and drawn, and so are trajectories.

Only pictures need anything but the standard library, and only when they are drawn.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.commands import is_name
from litegrip_client.ctl.commands.trajectories import fetched_whole
from litegrip_client.ctl.files import put_file, refuse_existing
from litegrip_client.ctl.parser import LateParser, in_unit, positive
from litegrip_client.ctl.run import Commands, Run, installing
from litegrip_client.values.errors import CommandError
from litegrip_client.values.figures import figure, plain
from litegrip_client.values.trajectory import Trajectory
from litegrip_client.values.trajectory_format import MAGIC

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
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise CommandError(
                f"the dump is {path} on the daemon's machine, but cannot be read from here: "
                f"{error.strerror}",
                reason="file_not_read",
                data={"hint": "copy it there, as a user who may read it", "path": path},
            ) from error
        put_file(target, content)
        path, data = target, {**data, "file": target}
    size = figure(data["bytes"] / 1e6, ".1f", "MB")
    length = figure(data["seconds"], ".0f", "s")
    return run.done(data, f"{length} ({data['ticks']} ticks, {size}) in {plain(path)}")


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
    parser.add_argument(
        "-o", "--output", metavar="PNG", help="the picture (default: beside FILE, as .png)"
    )
    parser.add_argument(
        "--last", type=in_unit(positive, "s"), metavar="S", help="only the last S seconds of it"
    )


def plot(run: Run) -> int:
    """Draw a dump or a trajectory."""
    options = run.options
    trajectory, file = _trajectory(run), Path(options.file)
    try:
        from litegrip_client.ctl.plot import drawing  # noqa: PLC0415 - needs the extra
    except ModuleNotFoundError as error:
        raise CommandError(
            f"plot needs the library {error.name}, which is not installed",
            reason="library_missing",
            data={"hint": installing("matplotlib", "mcap")},
        ) from error
    if trajectory is not None:
        drawn = drawing.draw_trajectory(trajectory, file.stem)
    else:
        drawn = drawing.draw(drawing.read(options.file), options.last)
    picture = drawing.png(drawn)
    target = options.output
    if not target:  # beside it, but the directory of this user's trajectories is no place for that
        target = f"{file.stem}.png" if options.local else str(file.with_suffix(".png"))
    put_file(target, picture)
    return run.done({"path": target}, f"drawn in {plain(target)}")


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
    # Of a grip that is under way where the picture begins, what is left of it is drawn.
    begin_s = trajectory.samples[-1].t - last_s
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


COMMANDS: Commands = {
    "dump": (dump, dump_options),
    "plot": (plot, plot_options),
}
