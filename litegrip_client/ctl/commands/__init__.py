"""The commands of `litegripctl`: each makes its calls, shows the result and returns an exit code.

Errors are raised, and shown by `main`. Only the module of the command that runs is imported, so
that a `state` does not wait for the others.
"""

from __future__ import annotations

import os
from argparse import Namespace
from importlib import import_module

from litegrip_client.ctl.parser import Fill
from litegrip_client.ctl.run import Command


class CommandRow:
    """One command: its name, its line in the list of commands, and its module in this folder.

    A module has `COMMANDS`: the functions of its commands, and what adds their arguments.
    """

    __slots__ = ("_module", "is_local", "name", "reads", "text")

    def __init__(
        self, name: str, text: str, module: str, *, reads: bool = False, is_local: bool = False
    ) -> None:
        self.name = name
        self.text = text
        self.reads = reads
        """True if it changes nothing: it may go to the only daemon that runs."""
        self.is_local = is_local
        """True if it asks no daemon for anything."""
        self._module = module

    def command(self) -> Command:
        """Return what carries it out."""
        return self._load()[0]

    def options(self) -> Fill | None:
        """Return what adds its arguments to a parser; None where it takes none."""
        return self._load()[1]

    def _load(self) -> tuple[Command, Fill | None]:
        module = import_module(f"{__name__}.{self._module}")
        found: tuple[Command, Fill | None] = module.COMMANDS[self.name]
        return found


COMMANDS = (
    CommandRow("state", "show the state once", "state", reads=True),
    CommandRow("watch", "show the state again and again", "state", reads=True),
    CommandRow("events", "show what has happened, and with -f what happens", "state", reads=True),
    CommandRow("enable", "enable the motor; it stays enabled", "motions"),
    CommandRow("disable", "disable the motor: no torque", "motions"),
    CommandRow("clear-fault", "clear a fault of the motor; it stays disabled", "motions"),
    CommandRow(
        "open", "open the jaws, to the calibration's work stroke or else to the stop", "motions"
    ),
    CommandRow("close", "close the jaws to the stop", "motions"),
    CommandRow("grasp", "close until something is held, and hold it with a force", "motions"),
    CommandRow("release", "open a little, to let go", "motions"),
    CommandRow("move", "move to an opening, a position or a share of the travel", "motions"),
    CommandRow("force", "change the force of a grasp, or begin to squeeze", "motions"),
    CommandRow("slack", "let the jaws be moved by hand, until 'hold'", "motions"),
    CommandRow("hold", "hold the present position", "motions"),
    CommandRow("teleop", "lead another gripper by hand, or follow one", "teleop"),
    CommandRow("stop", "stop the gripper, whichever client moves it, until 'clear'", "state"),
    CommandRow("clear", "clear a stop; moves nothing", "state"),
    CommandRow("clients", "list who is connected, and what each has cost", "state", reads=True),
    CommandRow("lease", "show who has the gripper to itself, or take it away", "state"),
    CommandRow("jobs", "list the running motions and the last ended ones", "motions", reads=True),
    CommandRow("job", "show one motion: how it ended, or where it is", "motions", reads=True),
    CommandRow("cancel", "cancel a motion; the jaws then hold", "motions"),
    CommandRow("zero", "measure the travel: moves to both stops", "calibration"),
    CommandRow(
        "calibration", "show, load, store the calibration, or make it by hand", "calibration"
    ),
    CommandRow("config", "show or change the daemon's defaults for motions", "daemon"),
    CommandRow("register", "read registers of the motor", "motions"),
    CommandRow("record", "record a motion that you push the jaws through", "trajectories"),
    CommandRow("play", "replay a recorded motion", "trajectories"),
    CommandRow("trajectories", "list what was recorded, copy or remove it", "trajectories"),
    CommandRow("dump", "write the last minute, tick by tick, to a file", "recorder"),
    CommandRow("plot", "draw a dump or a trajectory as a picture", "recorder"),
    CommandRow(
        "doctor",
        "check link, daemon, motor and calibration; say what corrects them",
        "machine",
        is_local=True,
    ),
    CommandRow(
        "health", "show how the daemon is; the exit code is the verdict", "daemon", reads=True
    ),
    CommandRow(
        "metrics",
        "print the figures of health for Prometheus",
        "daemon",
        reads=True,
    ),
    CommandRow(
        "fleet", "list the grippers of other machines, or stop a whole site", "fleet", is_local=True
    ),
    CommandRow("restart", "restart the daemon without letting go of what is held", "daemon"),
    CommandRow(
        "install-units", "install what lets systemd run the daemons", "machine", is_local=True
    ),
    CommandRow(
        "info", "show what does not change: versions, motor, calibration", "daemon", reads=True
    ),
    CommandRow("sim", "change the world of a simulated gripper: object, hand, faults", "sim"),
    CommandRow(
        "completion", "print what completes command lines in a shell", "machine", is_local=True
    ),
    CommandRow(
        "discover",
        "list the methods of the daemon (with --json: its OpenRPC document)",
        "daemon",
        reads=True,
    ),
)


def needs_daemon(options: Namespace) -> bool:
    """Return True if the command line asks for something of the daemon's."""
    if options.command == "plot":
        return is_name(options.file) and not options.local
    if options.command == "trajectories":
        return not options.local
    return not _row(options.command).is_local


def is_name(text: str) -> bool:
    """Return True if it can only be a name of the daemon's, and no file here."""
    if not text or "/" in text or os.path.exists(text):  # noqa: PTH110 - pathlib takes 4 ms
        return False
    return "." not in text[1:].rstrip(".")  # behind a dot begins the ending of a file


def find(name: str) -> Command:
    """Return the command of that name, which the command line has checked."""
    return _row(name).command()


def _row(name: str) -> CommandRow:
    return next(row for row in COMMANDS if row.name == name)
