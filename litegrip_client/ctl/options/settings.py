"""Options of the commands that read and change settings."""

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import setting

_CONFIG = """\
Show or change the defaults that the daemon uses for motions. Without an action
all are shown, with what is allowed.
"""
_REGISTERS = """\
examples:
  litegripctl register PMAX VMAX TMAX
  litegripctl register 21 0x15
"""


def config(parser: LateParser) -> None:
    """Take what to do."""
    parser.description = _CONFIG
    parser.set_defaults(field=None)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser)
    actions.add_parser("get", help="show all fields, or one", fill=_get)
    actions.add_parser("set", help="change fields", fill=_set)


def _get(parser: LateParser) -> None:
    parser.description = "Show all fields with what is allowed, or the value of one."
    parser.add_argument("field", nargs="?", metavar="FIELD", help="force_n, for one")
    parser.words["field"] = "fields"


def _set(parser: LateParser) -> None:
    parser.description = "Change fields for all clients, until the daemon restarts."
    parser.epilog = "example:\n  litegripctl config set force_n=15 speed_mm_s=30 --keep"
    parser.add_argument("fields", nargs="+", type=setting, metavar="FIELD=VALUE", help="numbers")
    parser.add_argument("--keep", action="store_true", help="also for after a restart")
    parser.words["fields"] = "settings"


def register(parser: LateParser) -> None:
    """Take which."""
    parser.description, parser.epilog = "Read registers of the motor.", _REGISTERS
    parser.add_argument(
        "registers", nargs="+", metavar="NAME|NUMBER", help="PMAX, 21 or 0x15, for one"
    )
