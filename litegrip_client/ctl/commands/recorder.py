"""The commands on the flight recorder: have it written, and draw what was written.

Only `plot` needs anything but the standard library, and only when it is run.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from litegrip_client.ctl import files
from litegrip_client.ctl.render import figure, plain
from litegrip_client.ctl.run import OK, Command, Run
from litegrip_client.errors import CommandError
from litegrip_client.link import ACTION_TIMEOUT_S

_INSTALL = "pip install 'litegripd[plot]'"


def dump(run: Run) -> int:
    """Have the recorder written; copy the file where that is wanted."""
    target, note = run.options.output, run.options.note
    if target is not None:
        files.refuse_existing(target, "take another name")
    params = {} if note is None else {"note": note}
    data = run.connection.call("recorder.dump", params, ACTION_TIMEOUT_S)
    path = data["path"]
    if target is not None:
        files.put(target, _content(path))
        path = target
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


def plot(run: Run) -> int:
    """Draw a dump."""
    options = run.options
    try:
        from litegrip_client.ctl.plot.draw import draw  # noqa: PLC0415 - needs the extra
        from litegrip_client.ctl.plot.dump import read  # noqa: PLC0415 - needs the extra
    except ModuleNotFoundError as error:
        raise CommandError(
            f"plot needs the library {error.name}, which is not installed",
            reason="library_missing",
            data={"hint": _INSTALL},
        ) from error
    target = options.output or str(Path(options.file).with_suffix(".png"))
    files.put(target, draw(read(options.file), options.last))
    run.output.result({"path": target}, f"drawn in {plain(target)}")
    return OK


COMMANDS: Mapping[str, Command] = {"dump": dump, "plot": plot}
