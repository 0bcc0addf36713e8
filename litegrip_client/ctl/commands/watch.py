"""The command that shows the state again and again: as a live view, as lines, or as JSON."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice

from litegrip_client.ctl.parser import LateParser, count, positive
from litegrip_client.ctl.render import Data, age, figure, is_unheard, plain
from litegrip_client.ctl.run import OK, Command, Fill, Run, installing

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeAlias

    from litegrip_client.ctl.live import Scene

Show: TypeAlias = "Callable[[Iterable[Scene], str, Callable[[str], str]], None]"


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


COMMANDS: Mapping[str, Command] = {"watch": watch}
OPTIONS: Mapping[str, Fill] = {
    "watch": watch_options,
}
