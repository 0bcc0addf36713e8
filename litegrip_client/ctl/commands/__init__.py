"""The commands of `litegripctl`: each makes its calls, has the result shown, gives an exit code.

Errors are raised; what they look like and which exit code they have is not decided here. Only
the module of the command that is run is imported, so that a `state` does not wait for the rest.
"""

from __future__ import annotations

from litegrip_client.ctl.run import Command

_MOTIONS = ("open", "close", "grasp", "release", "move", "force", "slack")


def find(name: str) -> Command:
    """Give the command of that name, which the command line has checked."""
    if name in _MOTIONS:
        from litegrip_client.ctl.commands.motions import COMMANDS  # noqa: PLC0415 - see above
    elif name in ("zero", "calibration"):
        from litegrip_client.ctl.commands.calibration import COMMANDS  # noqa: PLC0415
    elif name in ("config", "register"):
        from litegrip_client.ctl.commands.settings import COMMANDS  # noqa: PLC0415
    elif name in ("clients", "lease", "stop"):
        from litegrip_client.ctl.commands.clients import COMMANDS  # noqa: PLC0415
    elif name == "teleop":
        from litegrip_client.ctl.commands.teleop import COMMANDS  # noqa: PLC0415
    else:
        from litegrip_client.ctl.commands.general import COMMANDS  # noqa: PLC0415
    return COMMANDS[name]
