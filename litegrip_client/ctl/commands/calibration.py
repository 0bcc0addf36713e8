"""The commands around the calibration: measure it, show it, load it, store it."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.ctl import files, terminal
from litegrip_client.ctl import render_results as render
from litegrip_client.ctl.commands.manual import manual
from litegrip_client.ctl.motion import finish
from litegrip_client.ctl.render import plain
from litegrip_client.ctl.run import NOT_OK, OK, Command, Run
from litegrip_client.errors import CommandError
from litegrip_client.link import ACTION_TIMEOUT_S

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any


def zero(run: Run) -> int:
    """Measure the travel by moving to both stops, once that is confirmed."""
    options = run.options
    if not options.yes:
        if not terminal.may_ask():
            return run.refuse(
                "zero moves the jaws to both stops, and there is no terminal to confirm it at",
                "if that is safe: litegripctl zero --yes",
            )
        if not terminal.confirm("the jaws will move to both stops; continue?"):
            run.output.error(CommandError("nothing was done", reason="not_wanted"), "")
            return NOT_OK
    params: dict[str, Any] = {"save": not options.no_save}
    if options.mount is not None:
        params["mount"] = options.mount
    return finish(run, "calibration.zero", params, lambda data: render.measured("zero", data))


def calibration(run: Run) -> int:
    """Do what `options.action` says."""
    return _ACTIONS[run.options.action or "show"](run)


def show(run: Run) -> int:
    """Show the calibration in use."""
    data = run.connection.call("calibration.get")
    run.output.result(data, render.calibration(data))
    return OK


def templates(run: Run) -> int:
    """Show which templates there are."""
    data = run.connection.call("calibration.templates")
    run.output.result(data, render.templates(data["templates"]))
    return OK


def load(run: Run) -> int:
    """Have the daemon use a template, a file of this side, or what it finds itself."""
    source = run.options.source
    params: dict[str, Any] = {}
    if source in render.TEMPLATES:
        params["template"] = source
    elif source is not None:
        params["content"] = files.read(source)
    data = run.connection.call("calibration.load", params)
    if data["loaded"] and run.options.keep:
        data = {**data, "saved": _store(run)}
    run.output.result(data, render.loaded(data, source=source))
    return OK if data["loaded"] else NOT_OK


def save(run: Run) -> int:
    """Have the daemon store the calibration in use, or write it to a file of this side."""
    path = run.options.file
    if path is None:
        data = _store(run)
        run.output.result(data, render.stored(data))
        return OK
    data = run.connection.call("calibration.get")
    content = data["content"]
    if not data["calibrated"] or not content:
        raise CommandError("there is no calibration to write", reason="not_calibrated")
    files.write(path, content, overwrite=run.options.overwrite)
    run.output.result({"path": path, "content": content}, f"written to {plain(path)}")
    return OK


def _store(run: Run) -> dict[str, Any]:
    return run.connection.call("calibration.save", None, ACTION_TIMEOUT_S)


_ACTIONS: Mapping[str, Command] = {
    "show": show,
    "templates": templates,
    "load": load,
    "save": save,
    "manual": manual,
}

COMMANDS: Mapping[str, Command] = {"zero": zero, "calibration": calibration}
