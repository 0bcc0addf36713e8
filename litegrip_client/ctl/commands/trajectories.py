"""The commands that record and replay."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.blocking import BlockingWire, pause, wait
from litegrip_client.core.recording import Recording
from litegrip_client.ctl import render_trajectories as render
from litegrip_client.ctl import terminal
from litegrip_client.ctl.commands.trajectory_store import refuse_unkeepable, showing
from litegrip_client.ctl.motion import finish
from litegrip_client.ctl.run import INTERRUPTED, OK, Command, Run
from litegrip_client.errors import CancelledError, CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any


_KEEP = "litegripctl trajectories keep NAME"
_CTRL_C = "Ctrl-C breaks it off and keeps nothing."


def record(run: Run) -> int:
    """Record for a while; the daemon keeps it under a name. It ends with this program."""
    options = run.options
    refuse_unkeepable(run, options.name, overwrite=options.overwrite)
    samples = max(1, round(options.seconds * options.rate))
    told = options.no_zero_gravity

    def show(status: dict[str, Any]) -> None:
        nonlocal told
        if not told:  # not before: where recording is refused the jaws are not slack
            told = True
            terminal.say(f"The jaws are slack for {options.seconds:g} s: push them. {_CTRL_C}")
        if run.output.live:
            run.output.line(render.recording(status, samples))

    recording = Recording(
        BlockingWire(run.connection),
        pause,
        duration_s=options.seconds,
        rate_hz=options.rate,
        zero_gravity=not options.no_zero_gravity,
        name=options.name,
        on_status=show,
    )
    try:
        data = wait(recording.run())
    except KeyboardInterrupt:
        run.output.erase_line()
        text = "interrupted: nothing was kept, the jaws hold"
        run.output.error(CancelledError(text, reason="interrupted"), "")
        return INTERRUPTED
    except CommandError as error:
        if error.reason not in ("not_saved", "trajectories_full"):
            raise
        hint = f"the recording stays until the next one begins; once there is room: {_KEEP}"
        data = {**error.data, "hint": hint}
        raise CommandError(error.message, reason=error.reason, data=data) from error
    run.output.erase_line()
    run.output.result(data, render.recorded(data))
    return OK


def play(run: Run) -> int:
    """Replay a trajectory of the daemon, or of this side."""
    options = run.options
    params: dict[str, Any] = {"repeat": options.repeat, "align": not options.no_align}
    if options.speed is not None:
        params["speed"] = options.speed
    if options.force != "path":
        params["force"] = options.force
    if options.local:
        params["upload"] = _uploaded(run)
    else:
        params["name"] = options.name
    return finish(run, "trajectory.play", params, render.played)


def _uploaded(run: Run) -> int:
    from litegrip_client.core.trajectory_transfer import send  # noqa: PLC0415 - seldom needed
    from litegrip_client.trajectory_files import read, read_grips  # noqa: PLC0415

    wire, content = BlockingWire(run.connection), read(run.options.name)
    grips = b"" if run.options.force == "path" else read_grips(run.options.name)
    with showing(run) as share:
        return int(wait(send(wire, content, None, share, grips))["upload"])


COMMANDS: Mapping[str, Command] = {"record": record, "play": play}
