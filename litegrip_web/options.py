"""The command line of `litegripd-web`, and its exit codes; its manual page is made of them."""

import argparse
from pathlib import Path

from litegrip_client.values.version import client_version

EXIT_OK, EXIT_ADDRESS, EXIT_USAGE = 0, 1, 2
EXIT_CODES = (
    (EXIT_OK, "a signal ended it"),
    (EXIT_ADDRESS, "it cannot listen at the address, or keep the token"),
    (EXIT_USAGE, "wrong usage"),
    (5, "a package is missing"),
)
"""The meaning of each, for the help and the manual page."""

DEFAULT_PORT = 8040


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="litegripd-web",
        allow_abbrev=False,
        description="A page in the browser for grippers of this machine. Whoever has its address, "
        "which ends with a secret, may look and stop; with --operate, also move.",
        epilog=f"exit codes: {', '.join(f'{code} {text}' for code, text in EXIT_CODES)}",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {client_version()}")
    parser.add_argument("channels", nargs="+", metavar="CHANNEL", help="whose daemons to show")
    parser.add_argument("--operate", action="store_true", help="let the page move the grippers")
    parser.add_argument(
        "--address",
        default="127.0.0.1",
        help="where to listen (default: %(default)s, which only this machine reaches); "
        "any other needs --certificate and --key",
    )
    parser.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="default: %(default)s; 0 takes a free one"
    )
    parser.add_argument(
        "--certificate", type=Path, metavar="FILE", help="of TLS, with its chain, as PEM"
    )
    parser.add_argument("--key", type=Path, metavar="FILE", help="of the certificate, as PEM")
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="HOST",
        help="a name by which browsers may ask for this machine; may be given again",
    )
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="keep the secret here, and do not print it; made where there is none "
        "(default: a new secret at each start, printed)",
    )
    parser.add_argument(
        "--socket", metavar="PATH", help="the daemon's socket, for a single channel"
    )
    return parser
