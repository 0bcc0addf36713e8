"""Options of the commands that look at things, switch the motor, stop, and see to jobs."""

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import count, positive

_RESTART = """\
Start a successor of the daemon, which reads the configuration anew and takes
over. The motor stays enabled, with the same pose and force. For admins, while
no motion runs."""

_WATCH = """\
Show the state again and again, until Ctrl-C. In a terminal this is a live view
of the whole gripper, which waits for a daemon that goes; it needs the library
rich: pip install rich. Elsewhere, and with --plain, a line for each state.
"""
_DUMP = """\
Have the daemon write its flight recorder: the last minute, tick by tick, with
all events, as an MCAP file on the daemon's machine. It does so by itself when
the motor faults, when an enabled motor falls silent, is disabled by nobody here
or loses its bus, when its position jumps, when a second master begins to
command it, and when a tick fails.
"""
_PLOT = """\
Draw a dump of the flight recorder: opening, torque, temperatures and lateness
over time, with what happened; or a trajectory. What is no file here, and has
neither a path nor an ending, is a trajectory that the daemon keeps. Pictures
need matplotlib and mcap: pip install matplotlib mcap
"""
_TAKE = """\
End somebody's lease, and with it the motion that runs; the gripper is nobody's
then. The jaws go on holding what they hold, whatever the loser wished. On a
terminal it asks first.
"""
_COMPLETION = """\
Print the script by which a shell completes commands, options and their values:
running channels, the daemon's trajectories, files.
"""
_COMPLETION_EXAMPLES = """\
examples:
  eval "$(litegripctl completion bash)"      for this shell, or in ~/.bashrc
  eval "$(litegripctl completion zsh)"       in ~/.zshrc, behind compinit
  litegripctl completion fish | source       in ~/.config/fish/config.fish
"""


def watch(parser: LateParser) -> None:
    """Take how often, until when, and in which form."""
    parser.description = _WATCH
    parser.add_argument("--hz", type=positive, default=5.0, metavar="N", help="0.1 to 200 (5)")
    parser.add_argument("--count", type=count, metavar="N", help="end after N states")
    parser.add_argument(
        "--plain", action="store_true", help="lines, and no live view, in a terminal as well"
    )


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
    parser.description = _TAKE
    parser.add_argument("why", metavar="REASON", help="told to the loser and to the log")
    parser.add_argument(
        "--release", action="store_true", help="let go of what is held: the jaws go slack"
    )
    parser.add_argument("-y", "--yes", action="store_true", help="do not ask first")


def dump(parser: LateParser) -> None:
    """Take why, and where to."""
    parser.description = _DUMP
    parser.add_argument("--note", metavar="TEXT", help="kept in the file: why it was asked for")
    parser.add_argument("-o", "--output", metavar="FILE", help="copy it to this file, here")
    parser.words["output"] = "files"


def plot(parser: LateParser) -> None:
    """Take what to draw, and how."""
    parser.description = _PLOT
    parser.add_argument("file", metavar="FILE|NAME", help="a dump, or a trajectory")
    parser.words |= {"file": "trajectories files", "output": "files"}
    parser.add_argument("--local", action="store_true", help="a trajectory of this user's")
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "-o", "--output", metavar="PNG", help="the picture (default: beside FILE, as .png)"
    )
    how.add_argument(
        "--text", action="store_true", help="a trajectory's quick look, here in the terminal"
    )
    parser.add_argument("--last", type=positive, metavar="S", help="only the last S seconds of it")


def restart(parser: LateParser) -> None:
    """Take that the jaws are to be held; without it nothing is done."""
    parser.description = _RESTART
    parser.add_argument("--hold", action="store_true", help="hold through the restart; required")


def cancel(parser: LateParser) -> None:
    """Take the job."""
    parser.add_argument("job", type=count, metavar="JOB", help="the number that 'jobs' shows")
    parser.words["job"] = "jobs"


def completion(parser: LateParser) -> None:
    """Take which shell."""
    parser.description, parser.epilog = _COMPLETION, _COMPLETION_EXAMPLES
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell")
