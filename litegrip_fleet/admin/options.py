"""The command line of `litegripd-fleet`, and its exit codes; its manual page is made of them."""

import argparse

from litegrip_client.core.sockets import STOP_LEVELS
from litegrip_client.core.stop import WHY_CHARACTERS
from litegrip_client.values.version import client_version

FILE = "/etc/litegripd/fleet.toml"

EXIT_OK, EXIT_FAILED, EXIT_USAGE, EXIT_NETWORK = 0, 1, 2, 3
EXIT_CODES = (
    (EXIT_OK, "done, or a signal ended it"),
    (
        EXIT_FAILED,
        "a socket cannot be made, a stop is not confirmed by all, or a check has found an error",
    ),
    (EXIT_USAGE, "wrong usage or configuration"),
    (EXIT_NETWORK, "the network cannot be used"),
)
"""The meaning of each, for the help and the manual page."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="litegripd-fleet",
        allow_abbrev=False,
        description="Grippers of other machines over a zenoh network: a gateway beside the daemons,"
        " a portal where they are used, a router between them.",
        epilog=f"exit codes: {', '.join(f'{code} {text}' for code, text in EXIT_CODES)}",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {client_version()}")
    parser.add_argument(
        "--config", default=FILE, metavar="FILE", help="the configuration (default: %(default)s)"
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("gateway", help="put this machine's grippers on the network")
    commands.add_parser("portal", help="give remote grippers sockets on this machine")
    commands.add_parser("router", help="let gateways and portals find each other, by the rules")
    checking = commands.add_parser(
        "check", help="check this machine's parts and what they reach; say what repairs them"
    )
    checking.add_argument("--json", action="store_true", help="print one JSON object")
    acl = commands.add_parser("acl", help="print the router's rules, as zenoh takes them")
    acl.add_argument(
        "--check",
        metavar="FILE",
        help="check a zenohd's configuration instead: print what it allows beyond these rules",
    )
    listing = commands.add_parser(
        "list", help="list the grippers that can be reached, and how they are"
    )
    listing.add_argument("site", nargs="?", default="*", metavar="SITE", help="default: all")
    listing.add_argument("--json", action="store_true", help="print one JSON array")
    stop = commands.add_parser("stop", help="stop all grippers of a site")
    stop.add_argument("site", metavar="SITE")
    stop.add_argument("--level", choices=STOP_LEVELS, default="hold")
    stop.add_argument("--json", action="store_true", help="print one JSON object")
    stop.add_argument(
        "--why",
        help="for the log and for those who find the grippers stopped:"
        f" {WHY_CHARACTERS} characters of it",
    )
    return parser
