"""Options of the commands on trajectories."""

import argparse

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import count, positive

_RECORD = """\
Record a motion: the jaws go slack, you push them through it, and the daemon
keeps what it measured under NAME. The motor must be enabled. Ctrl-C breaks it
off and keeps nothing; the jaws hold at the end in any case.
"""
_PLAY = """\
Replay a recorded motion: go to its start, then along its path, then hold. It
repeats positions; with --force replay also what was gripped, with its force.
Ctrl-C cancels it.
"""
_TRAJECTORIES = """\
What was recorded: the daemon keeps it by name. Without an action it is listed;
with --local that of this user, in ~/.litegrip/trajectories or where
LITEGRIP_TRAJ_DIR says.
"""
_KEEP = """\
Keep the latest recording, for which there was no room, or whose disk failed.
The daemon has it until the next one begins, or until it ends.
"""
_NAME = "the daemon's name of it"


def record(parser: LateParser) -> None:
    """Take what, how long and how."""
    parser.description = _RECORD
    parser.add_argument("name", metavar="NAME", help="what the daemon shall keep it under")
    parser.add_argument(
        "--seconds", type=positive, required=True, metavar="S", help="how long, in s"
    )
    parser.add_argument(
        "--rate", type=positive, default=100.0, metavar="HZ", help="samples a second (100)"
    )
    parser.add_argument(
        "--no-zero-gravity",
        action="store_true",
        help="leave the jaws as they are: watch what another program makes them do",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace one of that name")


def play(parser: LateParser) -> None:
    """Take what, how often and how fast."""
    parser.description = _PLAY
    _kept(parser)
    parser.add_argument("--repeat", type=count, default=1, metavar="N", help="so many passes (1)")
    parser.add_argument(
        "--speed", type=positive, metavar="X", help="a multiple of the taught one, 0.1 to 4 (1)"
    )
    parser.add_argument(
        "--no-align", action="store_true", help="do not go to its start first: be there already"
    )
    parser.add_argument(
        "--force",
        choices=("path", "replay"),
        default="path",
        help="go along the path alone (path), or do its grips again with their force (replay)",
    )
    parser.add_argument(
        "--local", action="store_true", help="NAME is a file of this side: a name, or a path"
    )


def actions(parser: LateParser) -> None:
    """Take what to do."""
    parser.description = _TRAJECTORIES
    parser.add_argument("--local", action="store_true", help="list this user's own ones")
    add = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser).add_parser
    add("list", help="list what the daemon keeps (default)", fill=_list)
    add("get", help="copy one of the daemon's to this side", fill=_get)
    add("put", help="copy one of this side to the daemon", fill=_put)
    add("delete", help="remove one of the daemon's", fill=_delete)
    add("keep", help="keep a recording that could not be kept", fill=_keep)
    add("export", help="show one of the daemon's as CSV", fill=_export)


def _list(parser: LateParser) -> None:
    parser.description = "List the trajectories that the daemon keeps, or this user."
    # Without a default, so that this place does not undo the one before the action.
    parser.add_argument(
        "--local",
        action="store_true",
        default=argparse.SUPPRESS,
        help="list this user's own ones",
    )


def _get(parser: LateParser) -> None:
    parser.description = "Copy a trajectory of the daemon to this user's directory."
    _kept(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="to this name or path instead")
    parser.words["output"] = "files"
    parser.add_argument("--overwrite", action="store_true", help="replace a file that exists")


def _put(parser: LateParser) -> None:
    parser.description = "Copy a trajectory of this side to the daemon."
    parser.add_argument("file", metavar="NAME|FILE", help="a name of this user's, or a path")
    parser.words["file"] = "own_trajectories files"
    parser.add_argument("--as", dest="name", metavar="NAME", help="the daemon's name of it")
    parser.add_argument("--overwrite", action="store_true", help="replace one of that name")


def _delete(parser: LateParser) -> None:
    parser.description = "Remove a trajectory that the daemon keeps."
    _kept(parser)


def _keep(parser: LateParser) -> None:
    parser.description = _KEEP
    parser.add_argument("name", metavar="NAME", help="what the daemon shall keep it under")
    parser.add_argument("--overwrite", action="store_true", help="replace one of that name")


def _export(parser: LateParser) -> None:
    parser.description = "Show the samples of a trajectory of the daemon as CSV."
    _kept(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write it to this file")
    parser.words["output"] = "files"


def _kept(parser: LateParser) -> None:
    """Take which of the daemon's."""
    parser.add_argument("name", metavar="NAME", help=_NAME)
    parser.words["name"] = "trajectories"
