"""Options of teleoperation."""

from __future__ import annotations

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import count, positive

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

_TELEOP = """\
Let one gripper follow another one. Enable both before.

Without --detach it shows how it goes until Ctrl-C ends it. Then the jaws hold;
those that the torque guard has let go of stay loose.
"""
_EXAMPLES = """\
examples:
  litegripctl teleop master                    lead: move these jaws by hand
  litegripctl teleop slave --host 10.0.0.20    follow that machine's gripper
  litegripctl teleop slave --fake-leader --torque-limit 1.0
                                               try the guard on a rigid object
  litegripctl teleop master --reflect-force 4
  litegripctl teleop slave --host 10.0.0.20 --reflect
                                               feel what is gripped, 4 N at most
"""


def teleop(parser: LateParser) -> None:
    """Take what to do."""
    parser.description, parser.epilog = _TELEOP, _EXAMPLES
    add = parser.add_subparsers(
        dest="action", required=True, metavar="ACTION", parser_class=LateParser
    ).add_parser
    # Behind these, --host is the other end of the link: so its machine is named in front.
    own: dict[str, Any] = {"conflict_handler": "resolve"}
    add("master", help="lead: the jaws go slack, and are moved by hand", fill=_master, **own)
    add("slave", help="follow a leader", fill=_slave, **own)
    add("status", help="show how it goes")
    add("stop", help="end it")


def _master(parser: LateParser) -> None:
    _link(parser)
    parser.add_argument(
        "--host", help="with --link udp: the follower's machine, or several: A,B,C:PORT"
    )
    parser.add_argument(
        "--rate", type=positive, metavar="HZ", help="frames a second (default: the control rate)"
    )
    parser.add_argument(
        "--reflect-force",
        type=positive,
        metavar="N",
        help="push back with what slaves press with, by N newtons at most (default: slack)",
    )
    parser.add_argument(
        "--reflect-gain", type=positive, metavar="SHARE", help="how much of it is felt (0.5)"
    )


def _slave(parser: LateParser) -> None:
    _link(parser)
    leader = parser.add_mutually_exclusive_group()
    leader.add_argument("--host", help="the leader's machine")
    leader.add_argument(
        "--fake-leader", action="store_true", help="follow a synthetic sweep, without a network"
    )
    parser.add_argument(
        "--torque-limit",
        type=positive,
        metavar="NM",
        help="let go at or over so much torque, in N·m (default: never)",
    )
    parser.add_argument(
        "--force-limit", type=positive, metavar="N", help="push by no more than this, in newtons"
    )
    parser.add_argument("--reflect", action="store_true", help="tell the leader that force")
    parser.add_argument(
        "--watchdog", type=positive, metavar="S", help="hold after so long without a frame (0.2)"
    )


def _link(parser: LateParser) -> None:
    parser.add_argument(
        "--link", choices=("zenoh", "udp"), help="how frames travel (zenoh); udp is not protected"
    )
    parser.add_argument("--port", type=count, metavar="N", help="the leader's port (17448)")
    parser.add_argument("--grip-id", metavar="ID", help="shared by both ends (gripA)")
    parser.add_argument(
        "--detach", action="store_true", help="leave it running, until 'teleop stop'"
    )
