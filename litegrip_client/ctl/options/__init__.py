"""The command line of `litegripctl`: which commands there are and what they take.

Imports nothing that is slow, and does nothing.
"""

from __future__ import annotations

import argparse
import os

from litegrip_client.ctl.options import (
    calibration,
    general,
    motions,
    settings,
    teleop,
    trajectories,
    units,
)
from litegrip_client.ctl.options.late import (
    CHANNEL_VARIABLE,
    DEFAULT_CHANNEL,
    Fill,
    LateParser,
    Parser,
    UsageError,
)
from litegrip_client.ctl.options.values import protect_target
from litegrip_client.discovery import check_channel
from litegrip_client.errors import CommandError

__all__ = ["UsageError", "parse", "whole_parser"]


def parse(given: list[str]) -> argparse.Namespace:
    """Read the command line; raises `UsageError` when it is wrong.

    `channel_chosen` tells whether a channel was asked for, by option or by environment.
    """
    parser = whole_parser()
    options, rest = parser.parse_known_args([protect_target(argument) for argument in given])
    if rest:
        message = f"unrecognized arguments: {' '.join(rest)}"
        raise UsageError(message, parser.format_usage(), options.help_of)
    chosen = getattr(options, "channel", None) or os.environ.get(CHANNEL_VARIABLE)
    options.channel_chosen = chosen is not None
    options.socket = getattr(options, "socket", None)
    options.ssh_host = getattr(options, "ssh_host", None)
    options.json = getattr(options, "json", False)
    if options.command == "grasp" and (options.width is None) != (options.tolerance is None):
        message = "grasp: --width and --tolerance go together: give both"
        raise UsageError(message, parser.format_usage(), options.help_of)
    try:
        options.channel = check_channel(chosen or DEFAULT_CHANNEL)
    except CommandError as error:
        parser.error(error.message)
    return options


class _WholeParser(Parser):
    def format_help(self) -> str:
        from litegrip_client.ctl.options.exit_codes import epilog  # noqa: PLC0415 - seldom needed

        self.epilog = epilog()
        return super().format_help()


def whole_parser() -> Parser:
    """Return the parser of all commands."""
    parser = _WholeParser(
        prog="litegripctl",
        description="Look at a LiteGrip gripper and drive it, through its daemon.",
    )
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=LateParser
    )

    def add(name: str, text: str, fill: Fill | None = None) -> None:
        commands.add_parser(name, help=text, description=text, fill=fill)

    add("state", "show the state once")
    add("watch", "show the state again and again", general.watch)
    add("enable", "enable the motor; it stays enabled", general.enable)
    add("disable", "disable the motor: no torque")
    add("clear-fault", "clear a fault of the motor; it stays disabled")
    add("open", "open the jaws to the stop", motions.to_stop)
    add("close", "close the jaws to the stop", motions.to_stop)
    add("grasp", "close until something is held, and hold it with a force", motions.grasp)
    add("release", "open a little, to let go", motions.release)
    add("move", "move to an opening, a position or a share of the travel", motions.move)
    add("force", "change the force of a grasp, or begin to squeeze", motions.force)
    add("slack", "let the jaws be moved by hand, until 'hold'")
    add("hold", "hold the present position")
    add("teleop", "lead another gripper by hand, or follow one", teleop.teleop)
    add("stop", "stop the gripper, whoever moves it, until 'clear'", general.stop)
    add("clear", "clear a stop; moves nothing")
    add("clients", "list who is connected, and what each has cost")
    add("lease", "show who has the gripper to itself, or take it away", general.lease)
    add("jobs", "list the running motions and the last ended ones")
    add("cancel", "cancel a motion; the jaws then hold", general.cancel)
    add("zero", "measure the travel: moves to both stops", calibration.zero)
    add("calibration", "show, load, store the calibration, or make it by hand", calibration.actions)
    add("config", "show or change the daemon's defaults for motions", settings.config)
    add("register", "read registers of the motor", settings.register)
    add("record", "record a motion that you push the jaws through", trajectories.record)
    add("play", "replay a recorded motion", trajectories.play)
    add("trajectories", "list what was recorded, copy or remove it", trajectories.actions)
    add("dump", "write the last minute, tick by tick, to a file", general.dump)
    add("plot", "draw a dump or a trajectory, as a picture or as text", general.plot)
    add("doctor", "check link, daemon, motor and calibration; say what mends them")
    add("health", "show how the daemon is; the exit code tells the verdict")
    add("metrics", "print the figures of health as OpenMetrics text, for Prometheus")
    add("restart", "restart the daemon without letting go of what is held", general.restart)
    add("install-units", "install what lets systemd run the daemons", units.install_units)
    add("info", "show what does not change: versions, motor, calibration")
    add("completion", "print what completes command lines in a shell", general.completion)
    add("discover", "list the methods of the daemon (with --json: its OpenRPC document)")
    return parser
