"""Options of the commands that look at things, switch the motor, stop, and see to jobs."""

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import count, positive


def watch(parser: LateParser) -> None:
    """Take how often, and until when."""
    parser.add_argument("--hz", type=positive, default=5.0, metavar="N", help="0.1 to 200 (5)")
    parser.add_argument("--count", type=count, metavar="N", help="end after N states")


def enable(parser: LateParser) -> None:
    """Take the number of attempts."""
    parser.add_argument("--retries", type=count, metavar="N", help="attempts at most, 1 to 20")


def stop(parser: LateParser) -> None:
    """Take what stopping means."""
    parser.add_argument(
        "--level",
        choices=("hold", "relax", "disable"),
        default="hold",
        help="hold the position (default), let go, or disable the motor",
    )
    parser.add_argument("--why", metavar="TEXT", help="shown to whoever is refused by the stop")


def lease(parser: LateParser) -> None:
    """Take what to do."""
    parser.description = "Show who has the gripper to itself. Without an action, just that."
    actions = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser)
    actions.add_parser("show", help="show it")
    actions.add_parser("take", help="end somebody's lease, and with it its motion", fill=_take)


def _take(parser: LateParser) -> None:
    parser.description = "End somebody's lease, and with it its motion; the gripper is free then."
    parser.add_argument("why", metavar="REASON", help="told to the loser and to the log")


def restart(parser: LateParser) -> None:
    """Take that the jaws are to be held; without it nothing is done."""
    parser.description = (
        "Start a successor of the daemon, which reads the configuration anew and takes over. The"
        " motor stays enabled, with the same pose and force. For admins, while no motion runs."
    )
    parser.add_argument("--hold", action="store_true", help="hold through the restart; required")


def cancel(parser: LateParser) -> None:
    """Take the job."""
    parser.add_argument("job", type=int, metavar="JOB", help="the number that 'jobs' shows")
