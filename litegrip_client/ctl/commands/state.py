"""The commands that show the state: once, or again and again as a live view or as lines."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice

from litegrip_client.ctl.parser import LateParser, count, positive
from litegrip_client.ctl.render import Data, figure, owner, plain
from litegrip_client.ctl.run import OK, Commands, Run, installing

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeAlias

    from litegrip_client.ctl.live import Scene

Show: TypeAlias = "Callable[[Iterable[Scene], str, Callable[[str], str]], None]"

_LABEL_WIDTH = 12
_MEASURED = {"opening", "position", "command", "velocity", "torque", "temperature", "status"}
"""Rows that say nothing of a motor that has never answered."""


def state(run: Run) -> int:
    """Show the state."""
    data = run.connection.call("state.get")
    run.output.result(data, _state_text(data))
    return OK


def _state_text(data: Data) -> str:
    """Show a state in aligned lines."""
    lines = [f"{label:<{_LABEL_WIDTH}} {plain(text)}" for label, text in state_rows(data)]
    if is_unheard(data):
        lines.insert(0, "the motor has not answered yet: nothing is known of it")
    elif data.get("stale"):
        lines.insert(0, f"{age(data)}: these are the last known figures")
    return "\n".join(lines)


def state_rows(data: Data) -> list[tuple[str, str]]:
    """Show a state as labels and texts; the texts may hold anything.

    What is measured is left out while the motor has never answered.
    """
    rows = _rows(data)
    if is_unheard(data):
        rows = [(label, text) for label, text in rows if label not in _MEASURED]
    return rows


def is_unheard(data: Data) -> bool:
    """Return True if the motor has never answered: no figure is known, not even an old one."""
    return "feedback_s" in data and data["feedback_s"] is None and data.get("age_s") is None


def _rows(data: Data) -> list[tuple[str, str]]:
    rows = [
        ("mode", f"{data.get('mode')} (motor {data.get('motor')}, bus {data.get('bus')})"),
        ("opening", f"{figure(data.get('opening_mm'), '.2f', 'mm')}, {_openness(data)} open"),
        ("position", figure(data.get("position_rad"), "+.4f", "rad")),
        ("command", _command(data, "command")),
        ("velocity", figure(data.get("velocity_rad_s"), "+.4f", "rad/s")),
        ("torque", _torque(data)),
        ("temperature", _temperature(data)),
        ("status", str(data.get("status"))),
        ("calibrated", f"yes, mount {data.get('mount')}" if data.get("calibrated") else "no"),
        ("age", age(data)),
    ]
    if data.get("force_set_n") is not None:
        rows.append(("squeezing", _squeezing(data)))
    if data.get("limited"):
        rows.append(("limited", ", ".join(map(str, data["limited"]))))
        rows.append(("requested", _command(data, "requested")))
    if data.get("job"):
        rows.append(("job", _job(data["job"])))
    if data.get("stop"):
        rows.append(("stop", _stop(data["stop"])))
    return rows


def age(data: Data) -> str:
    """Show how old a state's feedback is, in capitals when it is too old."""
    seconds = data.get("age_s")
    if is_unheard(data):
        return "no answer yet"
    if data.get("stale"):
        return f"STALE, {figure(seconds, '.1f', 's')} old" if seconds is not None else "STALE"
    return figure(seconds, ".3f", "s")


def _openness(data: Data) -> str:
    openness = data.get("openness")
    return f"{openness:.0%}" if isinstance(openness, int | float) else "--"


def _torque(data: Data) -> str:
    torque = figure(data.get("torque_nm"), "+.3f", "N·m")
    return f"{torque}, force about {figure(data.get('force_n'), '+.1f', 'N')}"


def _command(data: Data, name: str) -> str:
    position = figure(data.get(f"{name}_rad"), "+.4f", "rad")
    torque = data.get(f"{name}_torque_nm")
    return position if torque is None else f"{position}, {figure(torque, '+.3f', 'N·m')}"


def _squeezing(data: Data) -> str:
    held = "an object is held" if data.get("is_grasped") else "no object is held"
    clamp_n = data.get("clamp_n")
    felt = ""
    if isinstance(clamp_n, Sequence) and len(clamp_n) == 2:
        low, high = (figure(bound, ".1f", "").rstrip() for bound in clamp_n)
        felt = f" ({low} to {high} N on the object)"
    unnoticed = ""
    if data.get("loss_detection") is False:
        from_n = figure(data.get("loss_detection_from_n"), ".1f", "N")
        unnoticed = f"; its loss would be noticed from {from_n} on"
    return f"with {figure(data['force_set_n'], '.1f', 'N')}{felt}, {held}{unnoticed}"


def _temperature(data: Data) -> str:
    driver = figure(data.get("driver_temperature_c"), ".0f", "°C")
    return f"driver {driver}, coil {figure(data.get('coil_temperature_c'), '.0f', '°C')}"


def _job(job: Data) -> str:
    by = owner(job.get("owner") or {})
    return f"{job.get('job')} {job.get('kind')}, {job.get('phase')}, by {by}"


def _stop(stop: Data) -> str:
    by = stop.get("by")
    who = owner(by) if isinstance(by, Mapping) else by
    why = f": {stop['why']}" if stop.get("why") else ""
    return f"{stop.get('level')}, by {who}{why} (clear it with: litegripctl clear)"


def state_line(data: Data) -> str:
    """Show a state in one line."""
    parts = [
        f"{data.get('mode')!s:<9}",
        f"{figure(data.get('opening_mm'), '7.2f', 'mm'):>10}",
        f"{figure(data.get('position_rad'), '+.4f', 'rad'):>12}",
        f"{figure(data.get('torque_nm'), '+.3f', 'N·m'):>11}",
        f"{figure(data.get('coil_temperature_c'), '.0f', '°C'):>6}",
    ]
    if data.get("job"):
        job = data["job"]
        phase = f" {job.get('phase')}" if job.get("kind") == "teleop" and job.get("phase") else ""
        parts.append(f"job {job.get('job')} {job.get('kind')}{phase}")
    if data.get("stop"):
        parts.append(f"STOP {data['stop'].get('level')}")
    if data.get("stale") or is_unheard(data):
        parts.append(age(data))
    return plain("  ".join(parts))


_WATCH = """\
Show the state again and again, until Ctrl-C. In a terminal this is a live view
of the whole gripper, which waits for a daemon that goes; it needs the library
rich: pip install rich. Elsewhere, and with --plain, a line for each state.
"""


def watch_options(parser: LateParser) -> None:
    """Take how often, until when, and in which form."""
    parser.description = _WATCH
    parser.add_argument("--hz", type=positive, default=5.0, metavar="N", help="0.1 to 200 (5)")
    parser.add_argument("--count", type=count, metavar="N", help="end after N states")
    parser.add_argument(
        "--plain", action="store_true", help="lines, and no live view, in a terminal as well"
    )


def watch(run: Run) -> int:
    """Show states until the count is reached or Ctrl-C is pressed."""
    show = _live_view(run)
    if show is None:
        return _lines(run)
    last: list[Scene] = []
    name = str(run.connection.call("hello")["channel"])
    if run.options.ssh_host is not None:
        name = f"{name} of {run.options.ssh_host}"
    try:
        show(_counted(run, last), name, run.output.for_gripper)
    finally:
        for scene in last:
            if scene.state is not None:  # the view itself leaves nothing in the terminal
                run.output.result(scene.state, state_line(scene.state))
    return OK


def _live_view(run: Run) -> Show | None:
    """Return what shows scenes; None where lines are wanted, or nothing else can be done."""
    if run.options.plain or not run.output.live or os.environ.get("TERM", "dumb") == "dumb":
        return None
    try:
        from litegrip_client.ctl.live import show  # noqa: PLC0415 - needs the extra
    except ModuleNotFoundError as error:
        text = f"lines only: the live view needs the library {error.name}: {installing('rich')}"
        run.output.note(text)
        return None
    return show


def _counted(run: Run, last: list[Scene]) -> Iterator[Scene]:
    """Give scenes, as many as are wanted; `last` holds the newest."""
    from litegrip_client.ctl.live import scenes  # noqa: PLC0415 - only the view needs it

    for scene in islice(scenes(run.way, run.connection, run.options.hz), run.options.count):
        last[:] = [scene]
        yield scene


def _lines(run: Run) -> int:
    """Show a line for each state, on a terminal, too."""
    with run.connection.subscribe_state(run.options.hz) as samples:
        for sample in islice(samples, run.options.count):
            run.output.result(sample.state, state_line(sample.state))
    return OK


COMMANDS: Commands = {
    "state": (state, None),
    "watch": (watch, watch_options),
}
