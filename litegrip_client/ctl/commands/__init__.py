"""The commands of `litegripctl`: each makes its calls, has the result shown, gives an exit code.

Errors are raised; what they look like and which exit code they have is not decided here. Only
the module of the command that is run is imported, so that a `state` does not wait for the rest.
"""

from __future__ import annotations

from argparse import Namespace
from importlib import import_module
from pathlib import Path

from litegrip_client.ctl.run import Command

_MODULES = {
    **dict.fromkeys(("open", "close", "grasp", "release", "move", "force", "slack"), "motions"),
    **dict.fromkeys(("zero", "calibration"), "calibration"),
    **dict.fromkeys(("config", "register"), "settings"),
    **dict.fromkeys(("clients", "lease", "stop"), "clients"),
    **dict.fromkeys(("record", "play"), "trajectories"),
    "trajectories": "trajectory_store",
    "plot": "plot",
    "dump": "recorder",
    "doctor": "doctor",
    "teleop": "teleop",
    "completion": "completion",
    "watch": "watch",
    "install-units": "units",
}
"""In which module of this room a command is; all others are in `general`."""


def needs_daemon(options: Namespace) -> bool:
    """Whether the command line asks for something of the daemon's."""
    if options.command == "plot":
        return is_name(options.file) and not options.local
    if options.command == "trajectories":
        return not options.local
    return options.command not in ("doctor", "completion", "install-units")


def is_name(text: str) -> bool:
    """Whether it can only be a name of the daemon's, and no file here."""
    path = Path(text)
    return path.name == text and not path.suffix and not path.exists()


def find(name: str) -> Command:
    """Give the command of that name, which the command line has checked."""
    module = import_module(f"{__name__}.{_MODULES.get(name, 'general')}")
    command: Command = module.COMMANDS[name]
    return command
