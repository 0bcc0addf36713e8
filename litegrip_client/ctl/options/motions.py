"""Options of the commands that move the jaws."""

from __future__ import annotations

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import not_negative, positive, target

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from argparse import _ActionsContainer

_GRASP = """\
Close until the jaws hold something, then squeeze it with a force.

Ends with the verdict whether something is held; the daemon goes on holding.
The exit code is 0 only when it is. Let go again with: litegripctl release
"""
_GRASP_EXAMPLES = """\
examples:
  litegripctl grasp --force 15
  litegripctl grasp --width 48 --tolerance 2    only this object will do
  litegripctl grasp --hold 5                    is it still held after 5 s?
"""
_MOVE_EXAMPLES = """\
examples:
  litegripctl move 45mm            45 mm between the jaws
  litegripctl move 50%             half open; 0% is closed
  litegripctl move -0.3rad         the position of the motor
  litegripctl move 45mm --duration 2
"""


def to_stop(parser: LateParser) -> None:
    """Take the speed."""
    _speed(parser)
    _no_wait(parser)


def grasp(parser: LateParser) -> None:
    """Take with which force, what is expected, and how to hold it."""
    parser.description, parser.epilog = _GRASP, _GRASP_EXAMPLES
    parser.add_argument(
        "--force", type=positive, metavar="N", help="in newtons, 0.5 to 30 (default: the daemon's)"
    )
    _speed(parser)
    parser.add_argument(
        "--width", type=positive, metavar="MM", help="how wide the object must be, in mm; give both"
    )
    parser.add_argument(
        "--tolerance",
        type=not_negative,
        metavar="MM",
        help="how far the width may be off, in mm; give both",
    )
    parser.add_argument(
        "--hold",
        type=not_negative,
        metavar="S",
        help="wait while it is held for S seconds, and see whether it still is",
    )
    parser.add_argument(
        "--gains", action="store_true", help="hold by position and gains, not by torque"
    )
    _no_wait(parser)


def release(parser: LateParser) -> None:
    """Take how far."""
    parser.description = (
        "Open by a distance from where the jaws are, at most to the open end of the\n"
        "calibrated travel, then hold."
    )
    parser.add_argument(
        "--by", type=positive, default=10.0, metavar="MM", help="how far to open, in mm (10)"
    )


def move(parser: LateParser) -> None:
    """Take where to, and how fast."""
    parser.description = "Move to a target, then hold."
    parser.epilog = _MOVE_EXAMPLES
    parser.add_argument(
        "target",
        type=target,
        metavar="TARGET",
        help="with its unit: 45mm (opening), -0.3rad (position of the motor), 50%% (of the travel)",
    )
    pace = parser.add_mutually_exclusive_group()
    _speed(pace)
    pace.add_argument("--duration", type=positive, metavar="S", help="how long it takes, in s")
    _no_wait(parser)


def force(parser: LateParser) -> None:
    """Take the force."""
    parser.description = (
        "Squeeze with another force from now on; jaws that hold nothing close with it."
    )
    parser.add_argument("newtons", type=positive, metavar="N", help="in newtons, 0.5 to 30")


def _speed(parser: _ActionsContainer) -> None:
    parser.add_argument(
        "--speed", type=positive, metavar="MM_S", help="in mm/s (default: the daemon's)"
    )


def _no_wait(parser: LateParser) -> None:
    parser.add_argument("--no-wait", action="store_true", help="do not wait for the end")
