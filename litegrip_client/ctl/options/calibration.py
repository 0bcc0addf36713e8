"""Options of the commands around the calibration."""

from litegrip_client.ctl.options.late import LateParser

_ZERO = """\
Measure the travel: move to both stops, gently, and use what was found.

Keep hands and objects out of the jaws. Which way the jaws close must be known
before: by the calibration in use, or by --mount.
"""
_CALIBRATION = """\
The calibration says where the two stops are, which way the jaws close, and how
far they move. Without an action it is shown.
"""
_MANUAL = """\
Calibrate by hand: the jaws go slack, you push them to both stops, and the
travel between is used. Nothing changes before you agree at the end.
"""


def zero(parser: LateParser) -> None:
    """Take what is known before, and what is agreed to."""
    parser.description = _ZERO
    parser.add_argument(
        "--mount",
        choices=("normal", "reverse"),
        help="which way the jaws close (default: as in the calibration in use)",
    )
    parser.add_argument(
        "--no-save", action="store_true", help="use what was found, but do not store it"
    )
    parser.add_argument("-y", "--yes", action="store_true", help="do not ask before moving")


def actions(parser: LateParser) -> None:
    """Take what to do."""
    parser.description = _CALIBRATION
    add = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser).add_parser
    add("show", help="show the calibration in use (default)")
    add("templates", help="show the nominal calibrations, one for each mount")
    add("load", help="use another calibration", fill=_load)
    add("save", help="store the calibration in use", fill=_save)
    add("manual", help="calibrate by hand", description=_MANUAL)


def _load(parser: LateParser) -> None:
    parser.description = "Use a template, a calibration file, or what the daemon finds itself."
    parser.usage = (
        "%(prog)s [-h] [-c CHANNEL | --socket PATH] [--json]\n"
        "       [--keep] (normal | reverse | FILE | --chain)"
    )
    parser.words["source"] = "templates files"
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "source",
        nargs="?",
        metavar="normal|reverse|FILE",
        help="a template, or a file of this machine, ./normal for one of that name",
    )
    source.add_argument(
        "--chain", action="store_true", help="what the daemon finds, as it does at its start"
    )
    parser.add_argument(
        "--keep", action="store_true", help="have the daemon store it for its next start"
    )


def _save(parser: LateParser) -> None:
    parser.description = "Store the calibration in use, for the daemon's next start or in a file."
    parser.add_argument(
        "file", nargs="?", metavar="FILE", help="write it to this file instead, here"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a FILE that exists")
    parser.words["file"] = "files"
