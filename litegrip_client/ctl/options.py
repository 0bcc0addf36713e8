"""The command line of `litegripctl`: which commands there are and what they take.

Imports nothing that is slow, and does nothing.
"""

import argparse
import math
import os

from litegrip_client.discovery import check_channel
from litegrip_client.errors import CommandError

CHANNEL_VARIABLE = "LITEGRIP_CHANNEL"
DEFAULT_CHANNEL = "can0"

_EPILOG = """\
exit codes:
  0    ok; the verdict "ok" of health
  1    the action ended, but not as it should (something blocks the jaws, say);
       the verdict "degraded" of health
  2    wrong usage; the verdict "down" of health
  3    no daemon to talk to, or no longer
  4    refused: not calibrated, a value out of its range, no such job
  5    the motor or its bus does not work
  6    busy: another motion is running
  7    stopped: a stop is latched (see: clear)
  8    the motion was cancelled
  70   a defect, or another version of the daemon
  130  interrupted by Ctrl-C
  141  whoever read the output has gone

A motion goes on when litegripctl is killed; Ctrl-C cancels it.
"""


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Read the command line; exits with 2 when it is wrong.

    `channel_chosen` tells whether a channel was asked for, by option or by environment.
    """
    parser = _parser()
    options = parser.parse_args(arguments)
    chosen = getattr(options, "channel", None) or os.environ.get(CHANNEL_VARIABLE)
    options.channel_chosen = chosen is not None
    options.socket = getattr(options, "socket", None)
    options.json = getattr(options, "json", False)
    try:
        options.channel = check_channel(chosen or DEFAULT_CHANNEL)
    except CommandError as error:
        parser.error(error.message)
    return options


def _parser() -> argparse.ArgumentParser:
    common = _common()
    parser = argparse.ArgumentParser(
        prog="litegripctl",
        description="Look at a LiteGrip gripper and drive it, through its daemon.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        parents=[common],
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=text, description=text, parents=[common])

    add("state", "show the state once")
    _add_watch(add("watch", "show the state again and again"))
    _add_enable(add("enable", "enable the motor; it stays enabled"))
    add("disable", "disable the motor: no torque")
    _add_motion(add("open", "open the jaws to the stop"))
    _add_motion(add("close", "close the jaws to the stop"))
    add("hold", "hold the present position")
    _add_stop(add("stop", "stop the gripper, whoever moves it, until 'clear'"))
    add("clear", "clear a stop; moves nothing")
    add("jobs", "list the running motions and the last ended ones")
    _add_cancel(add("cancel", "cancel a motion; the jaws then hold"))
    add("health", "show how the daemon is; the exit code tells the verdict")
    add("info", "show what does not change: versions, motor, calibration")
    add("discover", "list the methods of the daemon (with --json: its OpenRPC document)")
    return parser


def _common() -> argparse.ArgumentParser:
    # Without defaults, so that an option counts in front of the command and behind it.
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where = common.add_mutually_exclusive_group()
    where.add_argument(
        "-c",
        "--channel",
        help=f"the daemon's channel (default: ${CHANNEL_VARIABLE}, else {DEFAULT_CHANNEL})",
    )
    where.add_argument("--socket", metavar="PATH", help="the daemon's socket")
    common.add_argument("--json", action="store_true", help="print results and errors as JSON")
    return common


def _add_watch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--hz", type=_positive, default=5.0, metavar="N", help="0.1 to 200 (5)")
    parser.add_argument("--count", type=_count, metavar="N", help="end after N states")


def _add_enable(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--retries", type=_count, metavar="N", help="attempts at most, 1 to 20")


def _add_motion(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--speed", type=_positive, metavar="MM_S", help="in mm/s (default: the daemon's)"
    )
    parser.add_argument("--no-wait", action="store_true", help="do not wait for the end")


def _add_stop(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--level",
        choices=("hold", "relax", "disable"),
        default="hold",
        help="hold the position (default), let go, or disable the motor",
    )
    parser.add_argument("--why", metavar="TEXT", help="shown to whoever is refused by the stop")


def _add_cancel(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("job", type=int, metavar="JOB", help="the number that 'jobs' shows")


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)
