"""Options of the command that installs the units for systemd."""

from pathlib import Path

from litegrip_client.ctl.options.late import LateParser
from litegrip_client.ctl.options.values import interface

_INSTALL_UNITS = """\
Install what lets systemd run the daemons of this installation: units, a user
and a group, a configuration to begin with. Says what it did, and which commands
come next; runs none of them. A configuration that is there stays as it is. What
an earlier call had brought up or allowed stays so, and is renewed.
"""


def install_units(parser: LateParser) -> None:
    """Take where to, and what else."""
    parser.description = _INSTALL_UNITS
    parser.add_argument(
        "--root", type=Path, default=Path("/"), metavar="DIR", help="a system below DIR (/)"
    )
    parser.add_argument(
        "--can",
        action="append",
        default=[],
        type=interface,
        metavar="NAME",
        help="also have this CAN interface brought up at 1 Mbit/s; may be repeated",
    )
    parser.add_argument(
        "--serial", action="store_true", help="also let the daemons use adapters at serial ports"
    )
    parser.add_argument(
        "--uninstall", action="store_true", help="remove it all; configuration and data stay"
    )
