"""The command on the flight recorder: have it written."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.ctl import files
from litegrip_client.ctl.render import figure, plain
from litegrip_client.ctl.run import OK, Command, Run
from litegrip_client.errors import CommandError
from litegrip_client.link import ACTION_TIMEOUT_S


def dump(run: Run) -> int:
    """Have the recorder written; copy the file where that is wanted."""
    target, note = run.options.output, run.options.note
    if target is not None:
        files.refuse_existing(target, "take another name")
    params = {} if note is None else {"note": note}
    data = run.connection.call("recorder.dump", params, ACTION_TIMEOUT_S)
    path = data["path"]
    if target is not None:
        files.put(target, _content(run, path))
        path, data = target, {**data, "file": target}
    size = figure(data["bytes"] / 1e6, ".1f", "MB")
    length = figure(data["seconds"], ".0f", "s")
    run.output.result(data, f"{length} ({data['ticks']} ticks, {size}) in {plain(path)}")
    return OK


def _content(run: Run, path: str) -> bytes:
    try:
        return run.way.content(path)
    except OSError as error:
        raise CommandError(
            f"the dump is {path} on the daemon's machine, but cannot be read from here: "
            f"{error.strerror}",
            reason="file_not_read",
            data={"hint": "copy it there, as a user who may read it", "path": path},
        ) from error


COMMANDS: Mapping[str, Command] = {"dump": dump}
