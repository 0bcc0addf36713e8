"""What is recorded and replayed, and what is kept of it: by the daemon, and here as files."""

from __future__ import annotations

import argparse
import contextlib
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.core.trajectories import Recording, fetch, fetch_grips, listed, named, send
from litegrip_client.ctl.files import put_file, refuse_existing
from litegrip_client.ctl.parser import LateParser, count, in_unit, positive
from litegrip_client.ctl.render import bar, finish, jaws_now, opening_of, verdict, why_not
from litegrip_client.ctl.run import INTERRUPTED, Command, Commands, Run, say
from litegrip_client.threads.blocking import BlockingWire, complete, pause
from litegrip_client.values.errors import (
    CancelledError,
    CommandError,
    TrajectoryNotFoundError,
)
from litegrip_client.values.figures import Data, Here, figure, plain
from litegrip_client.values.printed import listed_text
from litegrip_client.values.trajectory import (
    Trajectory,
    directory,
    grips_counted,
    list_trajectories,
    path_of,
    read_file,
    read_grips,
    write_file,
)
from litegrip_client.values.trajectory_format import ENDING

_PLAIN_BYTES = 64
_REPLACE = "take another name, or replace it with: --overwrite"


_TRAJECTORIES = """\
What was recorded: the daemon keeps it by name. Without an action it is listed;
with --local that of this user, in ~/.litegrip/trajectories or where
LITEGRIP_TRAJ_DIR says.
"""
_KEEP_HELP = """\
Keep the latest recording, for which there was no room, or whose disk failed;
with --partial also one that was broken off, as far as it goes. The daemon has
it until the next one begins, or until it ends.
"""


def actions_options(parser: LateParser) -> None:
    """Add the actions of `trajectories`, and their arguments."""
    parser.description = _TRAJECTORIES
    parser.add_argument("--local", action="store_true", help="list this user's own ones")
    add = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser).add_parser
    add("list", help="list what the daemon keeps (default)", fill=_list_options)
    add("get", help="copy one of the daemon's to this side", fill=_get_options)
    add("put", help="copy one of this side to the daemon", fill=_put_options)
    add("delete", help="remove one of the daemon's", fill=_delete_options)
    add("keep", help="keep a recording that could not be kept", fill=_keep_options)
    add("export", help="show one of the daemon's as CSV", fill=_export_options)


def _list_options(parser: LateParser) -> None:
    parser.description = "List the trajectories that the daemon keeps, or this user."
    # Without a default, so that this place does not undo the one before the action.
    parser.add_argument(
        "--local",
        action="store_true",
        default=argparse.SUPPRESS,
        help="list this user's own ones",
    )


def _get_options(parser: LateParser) -> None:
    parser.description = "Copy a trajectory of the daemon to this user's directory."
    _kept_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="to this name or path instead")
    parser.add_argument("--overwrite", action="store_true", help="replace a file that exists")


def _put_options(parser: LateParser) -> None:
    parser.description = "Copy a trajectory of this side to the daemon."
    parser.add_argument("file", metavar="NAME|FILE", help="a name of this user's, or a path")
    parser.add_argument("--as", dest="name", metavar="NAME", help="the daemon's name of it")
    parser.add_argument("--overwrite", action="store_true", help="replace one of that name")


def _delete_options(parser: LateParser) -> None:
    parser.description = "Remove a trajectory that the daemon keeps."
    _kept_options(parser)


def _keep_options(parser: LateParser) -> None:
    parser.description = _KEEP_HELP
    parser.add_argument("name", metavar="NAME", help="the name under which the daemon keeps it")
    parser.add_argument(
        "--partial", action="store_true", help="one that was broken off is fine, too"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace one of that name")


def _export_options(parser: LateParser) -> None:
    parser.description = "Show the samples of a trajectory of the daemon as CSV."
    _kept_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write it to this file")


def trajectories(run: Run) -> int:
    """Do what `options.action` says."""
    action = run.options.action or "list"
    if run.options.local and action != "list":
        return run.refuse(
            f"--local does not go with {action}",
            run.here(f"see: litegripctl trajectories {action} --help"),
        )
    return _ACTIONS[action](run)


def show(run: Run) -> int:
    """List what the daemon keeps, or this user."""
    if run.options.local:
        files = map(asdict, list_trajectories())
        own = [{**file, "created_s": file["created"]} for file in files]  # as the daemon has it
        return run.done({"trajectories": own, "directory": str(directory())}, listed_text(own))
    rows, usage = kept_and_usage(run)
    text = listed_text(rows, owners=usage is not None)
    if usage is not None:
        most, most_mb = usage["most_named"], usage["most_bytes"] / 1e6
        has = f"{usage['named']} of {most}, {usage['bytes'] / 1e6:.1f} of {most_mb:g} MB"
        text += f"\nof uid {usage['uid']}, who asks: {has}"
    return run.done({"trajectories": rows, **({"usage": usage} if usage else {})}, text)


def get(run: Run) -> int:
    """Copy one of the daemon's to this side."""
    options = run.options
    target = options.output or options.name
    path = path_of(target)
    if not options.overwrite:
        refuse_existing(str(path), _REPLACE)
    trajectory, content = fetched_whole(run, {"name": options.name})
    write_file(target, content, trajectory.grip_bytes())
    return run.done({"name": options.name, "path": str(path)}, f"written to {plain(path)}")


def put(run: Run) -> int:
    """Copy one of this side to the daemon."""
    options = run.options
    with of_this_side(run, options.file, "trajectories put"):
        content = read_file(options.file)
    name = options.name or path_of(options.file).stem
    if not options.overwrite:
        refuse_kept(run, name)
    grips = grips_beside(options.file, content)
    with of_this_side(run, options.file, "trajectories put"), showing(run) as share:
        data = complete(send(BlockingWire(run.connection), content, {"name": name}, share, grips))
    return run.done(data, f"kept as {plain(data['name'])}, {counted(data['samples'])}")


def delete(run: Run) -> int:
    """Remove one of the daemon's."""
    params = {"name": run.options.name}
    data = run.connection.call("trajectory.delete", params, ACTION_TIMEOUT_S)
    return run.done(data, f"deleted: {plain(run.options.name)}")


def export(run: Run) -> int:
    """Show one of the daemon's as CSV, or write that to a file."""
    name, target = run.options.name, run.options.output
    if target is not None:
        refuse_existing(target, "take another name")
    content = fetched(run, {"name": name, "format": "csv"})
    if target is not None:
        put_file(target, content)
        return run.done({"name": name, "path": target}, f"written to {plain(target)}")
    text = content.decode()
    return run.done({"name": name, "csv": text}, text.removesuffix("\n"))


def keep(run: Run) -> int:
    """Have the daemon keep the latest recording, which it could not keep before."""
    name = run.options.name
    if not run.options.overwrite:
        refuse_kept(run, name)
    status = run.connection.call("trajectory.status")
    if status["active"] and status["kind"] == "record":
        text = "a recording is under way: it is kept by the program that records"
        raise CommandError(text, reason="trajectory_busy", data={"hint": "wait for its end"})
    params = {"name": name, **({"allow_partial": True} if run.options.partial else {})}
    data = run.connection.call("trajectory.record_stop", params, ACTION_TIMEOUT_S)
    return run.done(data, recorded_text(data, run.here))


def kept_and_usage(run: Run) -> tuple[Sequence[Data], Data | None]:
    """Return the daemon's list of all that it keeps, and what this user has of it and may have.

    The latter is None from an older daemon.
    """
    return complete(listed(BlockingWire(run.connection)))


def refuse_kept(run: Run, name: str) -> None:
    """Raise `CommandError` for a name that the daemon has already, usable or not."""
    _refuse_name(kept_and_usage(run)[0], name)


def refuse_unkeepable(run: Run, name: str, *, overwrite: bool) -> None:
    """Raise `CommandError`, before anything is recorded, where it could not be kept as `name`."""
    if not _is_plain_name(name):  # whether a trajectory can have it is the daemon's to say
        try:
            run.connection.call("trajectory.get", {"name": name, "offset": 0, "length": 1})
        except CommandError as error:
            if error.reason == "invalid_params" or "/" in name:
                raise
    rows, usage = kept_and_usage(run)
    if not overwrite:
        _refuse_name(rows, name)
    replaced = [row for row in rows if row["name"] == name]
    if usage is None or any(row.get("uid") == usage["uid"] for row in replaced):
        return
    if usage["named"] >= usage["most_named"]:
        text = (
            f"there is no room for another trajectory of uid {usage['uid']}: {usage['named']} of"
            f" {usage['most_named']} are there; nothing was recorded"
        )
        hint = run.here("make room: litegripctl trajectories delete NAME")
        raise CommandError(text, reason="trajectories_full", data={"hint": hint, "usage": usage})


def _is_plain_name(name: str) -> bool:
    """Return True for a name that every daemon allows: one that is free need not be asked for.

    The daemon's log would have a refusal of each recording that succeeds.
    """
    plain_ones = all(letter.isalnum() or letter in "_-. " for letter in name)
    ends = name[:1] != "." and name == name.strip()
    return plain_ones and ends and 1 <= len(name.encode()) <= _PLAIN_BYTES


def _refuse_name(rows: Iterable[Data], name: str) -> None:
    if any(row["name"] == name for row in rows):
        text = f"the daemon keeps a trajectory {plain(name)} already"
        raise CommandError(text, reason="file_exists", data={"hint": _REPLACE})


def fetched(run: Run, source: Data) -> bytes:
    """Fetch one of the daemon's, with a bar where it can be seen."""
    with showing(run) as share:
        return complete(fetch(BlockingWire(run.connection), source, share))


def fetched_whole(run: Run, source: Data) -> tuple[Trajectory, bytes]:
    """Fetch one of the daemon's with its grips; return it, and the content of its `.lgt`."""
    content = fetched(run, source)
    trajectory = Trajectory.from_bytes(content)
    try:
        beside = complete(fetch_grips(BlockingWire(run.connection), source))
        return trajectory.with_grips(content, beside), content
    except CommandError as error:  # also an older daemon, which knows of no grips
        say(f"the grips are left out: {error.message}")
        return trajectory, content


def grips_beside(name: str, content: bytes) -> bytes:
    """Return the file of grips beside one of this side; nothing where it cannot be used."""
    try:
        beside = read_grips(name)
        if beside:
            Trajectory.from_bytes(content).with_grips(content, beside)
        return beside
    except CommandError as error:
        say(f"the grips are left out: {error.message}")
        return b""


@contextlib.contextmanager
def of_this_side(run: Run, name: str, command: str) -> Iterator[None]:
    """Have an error about a file of this side, which a command was given, say what helps."""
    try:
        yield
    except TrajectoryNotFoundError as error:
        hint = "yours: litegripctl trajectories --local"
        if "/" not in name:
            hint += "; a path does, too"
        if found := _in_this_folder(name):
            hint = f"the one in this folder: litegripctl {command} {shlex.quote(found)}"
        error.data["hint"] = run.here(hint)
        raise
    except CommandError as error:
        if error.reason == "trajectory_unreadable" and not error.retryable:
            hint = "copy the file again, or record the motion again: litegripctl record NAME"
            error.data["hint"] = run.here(hint)
        raise


def _in_this_folder(name: str) -> str | None:
    """Return the path of a file in the current folder that a name without one may mean."""
    files = () if "/" in name else (name, f"{name}{ENDING}")
    return next((f"./{file}" for file in files if Path(file).is_file()), None)


@contextlib.contextmanager
def showing(run: Run) -> Iterator[Callable[[float], None]]:
    """Yield a function that shows the share that is done."""

    def share(done: float) -> None:
        if run.output.live:
            run.output.line(f"{bar(done)} {done:.0%}")

    try:
        yield share
    finally:
        run.output.erase_line()


_ACTIONS: Mapping[str, Command] = {
    "list": show,
    "get": get,
    "put": put,
    "delete": delete,
    "keep": keep,
    "export": export,
}


_KEEP = "litegripctl trajectories keep NAME"
_CTRL_C = "Ctrl-C breaks it off and keeps nothing."


_RECORD = """\
Record a motion: the jaws go slack, you push them through it, and the daemon
keeps what it measured under NAME. The motor must be enabled. Without --seconds
Ctrl-C ends it, and it is kept; with them Ctrl-C breaks it off, and nothing is
kept. The jaws hold at the end in any case.
"""


def record_options(parser: LateParser) -> None:
    """Add the arguments of `record`."""
    parser.description = _RECORD
    parser.add_argument("name", metavar="NAME", help="the name under which the daemon keeps it")
    parser.add_argument(
        "--seconds",
        type=in_unit(positive, "s"),
        metavar="S",
        help="how long, in s (default: until Ctrl-C)",
    )
    parser.add_argument(
        "--rate",
        type=in_unit(positive, "Hz"),
        default=100.0,
        metavar="HZ",
        help="samples a second (100)",
    )
    parser.add_argument(
        "--no-zero-gravity",
        action="store_true",
        help="leave the jaws as they are: watch what another program makes them do",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace one of that name")


def record(run: Run) -> int:
    """Record for a while; the daemon keeps it under a name. It ends with this program."""
    options = run.options
    refuse_unkeepable(run, options.name, overwrite=options.overwrite)
    seconds = options.seconds
    samples = None if seconds is None else max(1, round(seconds * options.rate))
    is_said = options.no_zero_gravity

    def show(status: Data) -> None:
        nonlocal is_said
        if not is_said:  # not before: where recording is refused the jaws are not slack
            is_said = True
            if seconds is None:
                say("The jaws are slack: push them. Ctrl-C ends it, and it is kept.")
            else:
                say(f"The jaws are slack for {seconds:g} s: push them. {_CTRL_C}")
        if run.output.live:
            got = status["samples"] + status["missed"]
            share = "" if samples is None else f"{bar(got / samples)} "
            length = figure(status.get("duration_s"), ".1f", "s")
            run.output.line(f"{share}{length}, {counted(status['samples'])}")

    recording = Recording(
        BlockingWire(run.connection),
        pause,
        duration_s=seconds,
        rate_hz=options.rate,
        zero_gravity=not options.no_zero_gravity,
        name=options.name,
        on_status=show,
    )
    try:
        data = complete(recording.run())
    except KeyboardInterrupt:
        run.output.erase_line()
        text = f"interrupted: nothing was kept, {jaws_now(run)}"
        run.output.error(CancelledError(text, reason="interrupted"), "")
        return INTERRUPTED
    except CommandError as error:
        if error.reason not in ("not_saved", "trajectories_full"):
            raise
        hint = f"the recording stays until the next one begins; once there is room: {_KEEP}"
        data = {**error.data, "hint": run.here(hint)}
        raise CommandError(error.message, reason=error.reason, data=data) from error
    run.output.erase_line()
    return run.done(data, recorded_text(data, run.here))


def counted(samples: object) -> str:
    """Return a number of samples in words."""
    return "1 sample" if samples == 1 else f"{samples} samples"


def recorded_text(data: Data, here: Here) -> str:
    """Return what was recorded, and its name."""
    missed = f", {data['missed']} missed" if data.get("missed") else ""
    length = figure(data.get("duration_s"), ".2f", "s")
    name = plain(data.get("name"))
    grips = f", {grips_counted(data['grips'])}" if data.get("grips") else ""
    text = f"record: {counted(data.get('samples'))} in {length}{missed}{grips}, kept as {name}"
    return f"{text}; {here('replay it with: litegripctl play')} {shlex.quote(name)}"


_PLAY = """\
Replay a recorded motion: go to its start, then along its path, then hold. It
repeats positions; with --force replay also what was gripped, with its force.
Ctrl-C cancels it.
"""


def play_options(parser: LateParser) -> None:
    """Add the arguments of `play`."""
    parser.description = _PLAY
    _kept_options(parser)
    parser.add_argument("--repeat", type=count, default=1, metavar="N", help="so many passes (1)")
    parser.add_argument(
        "--speed", type=positive, metavar="X", help="a multiple of the taught one, 0.1 to 4 (1)"
    )
    parser.add_argument(
        "--no-align", action="store_true", help="do not go to its start first: be there already"
    )
    parser.add_argument(
        "--force",
        choices=("path", "replay"),
        default="path",
        help="go along the path alone (path), or do its grips again with their force (replay)",
    )
    parser.add_argument(
        "--local", action="store_true", help="NAME is a file of this side: a name, or a path"
    )


def _kept_options(parser: LateParser) -> None:
    """Add the name of a trajectory that the daemon keeps."""
    parser.add_argument("name", metavar="NAME", help="the daemon's name of it")


def play(run: Run) -> int:
    """Replay a trajectory of the daemon, or of this side."""
    options = run.options
    params: dict[str, object] = {"repeat": options.repeat, "align": not options.no_align}
    if options.speed is not None:
        params["speed"] = options.speed
    if options.force != "path":
        params["force"] = options.force
    if options.local:
        wire = BlockingWire(run.connection)
        with of_this_side(run, options.name, "play --local"), showing(run) as share:
            content = read_file(options.name)
            grips = b"" if options.force == "path" else read_grips(options.name)
            params.update(named(complete(send(wire, content, None, share, grips))))
    else:
        params["name"] = options.name
    try:
        return finish(run, "trajectory.play", params, lambda data: played_text(data, run.here))
    except CommandError as error:
        if error.reason == "invalid_params" and not options.local and "/" in options.name:
            put, play_it = shlex.quote(options.name), shlex.quote(path_of(options.name).stem)
            hint = f"litegripctl trajectories put {put} && litegripctl play {play_it}"
            error.data["hint"] = run.here(f"give the daemon that file, and play it: {hint}")
        raise


def played_text(data: Data, here: Here) -> str:
    """Return how a replay ended."""
    loops = data.get("loops")
    passes = f"{loops} pass" if loops == 1 else f"{loops} passes"
    behind = figure(data.get("largest_lag_mm"), ".1f", "mm")
    text = f"play: {verdict(data)}, {passes}, at {opening_of(data)}, at most {behind} behind"
    if data.get("grips"):
        width = figure(data.get("width_mm"), ".1f", "mm")
        differs = figure(data.get("width_difference_mm"), "+.1f", "mm")
        grips = grips_counted(data["grips"])
        text += f"; {grips}, the last one {width} wide, at most {differs} to taught"
    return f"{text}{why_not(data, here)}"


COMMANDS: Commands = {
    "trajectories": (trajectories, actions_options),
    "record": (record, record_options),
    "play": (play, play_options),
}
