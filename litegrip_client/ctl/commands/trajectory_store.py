"""What is kept of trajectories: by the daemon, by name, and on this side, as files."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict

from litegrip_client.blocking import BlockingWire, wait
from litegrip_client.core.trajectory_transfer import fetch, fetch_grips, send
from litegrip_client.ctl import files, terminal
from litegrip_client.ctl import render_trajectories as render
from litegrip_client.ctl.render import plain
from litegrip_client.ctl.render_results import bar
from litegrip_client.ctl.run import OK, Command, Run
from litegrip_client.errors import CommandError
from litegrip_client.link import ACTION_TIMEOUT_S
from litegrip_client.trajectory import Trajectory
from litegrip_client.trajectory_files import (
    directory,
    list_trajectories,
    path_of,
    read,
    read_grips,
    write,
)

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

_REPLACE = "take another name, or replace it with: --overwrite"


def trajectories(run: Run) -> int:
    """Do what `options.action` says."""
    action = run.options.action or "list"
    if run.options.local and action != "list":
        return run.refuse(
            f"--local does not go with {action}", f"see: litegripctl trajectories {action} --help"
        )
    return _ACTIONS[action](run)


def show(run: Run) -> int:
    """List what the daemon keeps, or this user."""
    if run.options.local:
        rows = [_row(asdict(file)) for file in list_trajectories()]
        run.output.result(
            {"trajectories": rows, "directory": str(directory())}, render.listed(rows)
        )
        return OK
    rows, usage = kept_and_usage(run)
    text = "\n".join([render.listed(rows, owners=usage is not None), *render.room(usage)])
    run.output.result({"trajectories": rows, **({"usage": usage} if usage else {})}, text)
    return OK


def get(run: Run) -> int:
    """Copy one of the daemon's to this side."""
    options = run.options
    target = options.output or options.name
    path = path_of(target)
    if not options.overwrite:
        files.refuse_existing(str(path), _REPLACE)
    trajectory, content = fetched_whole(run, {"name": options.name})
    write(target, content, trajectory.grip_bytes())
    run.output.result({"name": options.name, "path": str(path)}, f"written to {plain(path)}")
    return OK


def put(run: Run) -> int:
    """Copy one of this side to the daemon."""
    options = run.options
    content = read(options.file)
    name = options.name or path_of(options.file).stem
    if not options.overwrite:
        refuse_kept(run, name)
    grips = grips_beside(options.file, content)
    with showing(run) as share:
        data = wait(send(BlockingWire(run.connection), content, {"name": name}, share, grips))
    run.output.result(data, f"kept as {plain(data['name'])}, {data['samples']} samples")
    return OK


def delete(run: Run) -> int:
    """Remove one of the daemon's."""
    params = {"name": run.options.name}
    data = run.connection.call("trajectory.delete", params, ACTION_TIMEOUT_S)
    run.output.result(data, f"deleted: {plain(run.options.name)}")
    return OK


def export(run: Run) -> int:
    """Show one of the daemon's as CSV, or write that to a file."""
    name, target = run.options.name, run.options.output
    if target is not None:
        files.refuse_existing(target, "take another name")
    content = fetched(run, {"name": name, "format": "csv"})
    if target is not None:
        files.put(target, content)
        run.output.result({"name": name, "path": target}, f"written to {plain(target)}")
        return OK
    text = content.decode()
    run.output.result({"name": name, "csv": text}, text.removesuffix("\n"))
    return OK


def keep(run: Run) -> int:
    """Have the daemon keep the latest recording, which it could not keep before."""
    name = run.options.name
    if not run.options.overwrite:
        refuse_kept(run, name)
    status = run.connection.call("trajectory.status")
    if status["active"] and status["kind"] == "record":
        text = "a recording is under way: it is kept by the program that records"
        raise CommandError(text, reason="trajectory_busy", data={"hint": "wait for its end"})
    data = run.connection.call("trajectory.record_stop", {"name": name}, ACTION_TIMEOUT_S)
    run.output.result(data, render.recorded(data))
    return OK


def kept(run: Run) -> list[dict[str, Any]]:
    """Return what the daemon tells of all that it keeps."""
    return kept_and_usage(run)[0]


def kept_and_usage(run: Run) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """Return that, and what this user has of it and may have; None from an older daemon."""
    rows: list[dict[str, Any]] = []
    usage, more = None, True
    while more:
        params = {"after": rows[-1]["name"]} if rows else {}
        answer = run.connection.call("trajectory.list", params, ACTION_TIMEOUT_S)
        rows += answer["trajectories"]
        more = answer["more"] and bool(answer["trajectories"])
        usage = answer.get("usage")
    return rows, usage


def refuse_kept(run: Run, name: str) -> None:
    """Raise `CommandError` for a name that the daemon has already, usable or not."""
    _refuse_name(kept(run), name)


def refuse_unkeepable(run: Run, name: str, *, overwrite: bool) -> None:
    """Raise `CommandError`, before anything is recorded, where it could not be kept as `name`."""
    _refuse_no_name(run, name)
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
        hint = "make room: litegripctl trajectories delete NAME"
        raise CommandError(text, reason="trajectories_full", data={"hint": hint, "usage": usage})


def _refuse_no_name(run: Run, name: str) -> None:
    """Raise `CommandError` where no trajectory can have this name: the daemon's is the rule."""
    try:
        run.connection.call("trajectory.get", {"name": name, "offset": 0, "length": 1})
    except CommandError as error:
        if error.reason == "invalid_params":
            raise


def _refuse_name(rows: list[dict[str, Any]], name: str) -> None:
    if any(row["name"] == name for row in rows):
        text = f"the daemon keeps a trajectory {plain(name)} already"
        raise CommandError(text, reason="file_exists", data={"hint": _REPLACE})


def fetched(run: Run, source: Mapping[str, Any]) -> bytes:
    """Fetch one of the daemon's, with a bar where it can be seen."""
    with showing(run) as share:
        return wait(fetch(BlockingWire(run.connection), source, share))


def fetched_whole(run: Run, source: Mapping[str, Any]) -> tuple[Trajectory, bytes]:
    """Fetch one of the daemon's with its grips; return it, and the content of its `.lgt`."""
    content = fetched(run, source)
    trajectory = Trajectory.from_bytes(content)
    try:
        beside = wait(fetch_grips(BlockingWire(run.connection), source))
        return trajectory.with_grips(content, beside), content
    except CommandError as error:  # also an older daemon, which knows of no grips
        terminal.say(f"the grips are left out: {error.message}")
        return trajectory, content


def grips_beside(name: str, content: bytes) -> bytes:
    """Return the file of grips beside one of this side; nothing where it cannot be used."""
    try:
        beside = read_grips(name)
        if beside:
            Trajectory.from_bytes(content).with_grips(content, beside)
        return beside
    except CommandError as error:
        terminal.say(f"the grips are left out: {error.message}")
        return b""


@contextlib.contextmanager
def showing(run: Run) -> Iterator[Callable[[float], None]]:
    """Give what shows the share that is done."""

    def share(done: float) -> None:
        if run.output.live:
            run.output.line(f"{bar(done)} {done:.0%}")

    try:
        yield share
    finally:
        run.output.erase_line()


def _row(file: dict[str, Any]) -> dict[str, Any]:
    """Name what a file tells as the daemon names it."""
    return {**file, "created_s": file.pop("created")}


_ACTIONS: Mapping[str, Command] = {
    "list": show,
    "get": get,
    "put": put,
    "delete": delete,
    "keep": keep,
    "export": export,
}

COMMANDS: Mapping[str, Command] = {"trajectories": trajectories}
