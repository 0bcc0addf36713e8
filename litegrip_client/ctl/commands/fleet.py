"""Commands about the grippers of other machines, which `litegripd-fleet` carries out.

That program brings what the network needs; this package has the standard library alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

from litegrip_client.core.discovery import FLEET_PROGRAM, program_of
from litegrip_client.core.sockets import STOP_LEVELS
from litegrip_client.ctl.parser import LateParser
from litegrip_client.ctl.run import WRONG_USAGE, Commands, Run, installing
from litegrip_client.values.errors import CommandError, ConnectError, ProtocolError

STOP = "stop"
_NO_NETWORK = 3
"""The exit code of the program where no router answers."""

_FLEET = """\
List the grippers of other machines that can be reached, all or those of SITE,
and how they are. With 'stop SITE', stop all grippers of a site, and say who has
not confirmed it (exit code 1). A stop over a network is no emergency stop.
"""
_FLEET_EXAMPLES = """\
examples:
  litegripctl fleet
  litegripctl fleet lab
  litegripctl fleet stop lab --level relax --why lunch
"""


def fleet_options(parser: LateParser) -> None:
    """Take a site, and whether to stop it."""
    parser.description, parser.epilog = _FLEET, _FLEET_EXAMPLES
    parser.add_argument("what", nargs="?", metavar="SITE|stop", help="default: all sites")
    parser.add_argument("site", nargs="?", metavar="SITE", help="the site to stop; '*' for all")
    parser.add_argument("--level", choices=STOP_LEVELS, help="of a stop (default: hold)")
    parser.add_argument("--why", help="of a stop, for the log and for those who find it stopped")
    parser.add_argument("--config", metavar="FILE", help="another configuration of the fleet")


def fleet(run: Run) -> int:
    """Have `litegripd-fleet` list or stop; returns its exit code."""
    options = run.options
    is_stop = options.what == STOP
    if is_stop and options.site is None:
        return run.refuse("fleet stop: which site?", "name it, or '*' for all: fleet stop lab")
    if not is_stop and (options.site or options.level or options.why):
        hint = f"to stop a site: fleet stop {options.what or 'SITE'}"
        return run.refuse("fleet lists one site, without --level and --why", hint)
    program = program_of(FLEET_PROGRAM)
    if program is None:
        raise CommandError(
            f"the program {FLEET_PROGRAM} is not found, neither beside this one nor in PATH",
            reason="library_missing",
            data={"hint": installing("litegrip-fleet")},
        )
    command = [program, *([] if options.config is None else ["--config", options.config])]
    if is_stop:
        command += [STOP, options.site]
        command += [] if options.level is None else ["--level", options.level]
        command += [] if options.why is None else ["--why", options.why]
    else:
        command += ["list", *([options.what] if options.what else [])]
    if options.json:
        return _as_json(run, [*command, "--json"])
    sys.stdout.flush()
    try:
        os.execv(program, command)  # noqa: S606 - nothing is left to do here
    except OSError as error:
        raise _unstartable(program, error) from error


def _unstartable(program: str, error: OSError) -> CommandError:
    text = f"{program} cannot be started: {error.strerror}"
    return CommandError(text, reason="library_missing")


def _as_json(run: Run, command: list[str]) -> int:
    """Print what it prints; raises its complaint, so that it is printed as every error is."""
    try:
        done = subprocess.run(command, capture_output=True, check=False)
    except OSError as error:
        raise _unstartable(command[0], error) from error
    try:
        data = json.loads(done.stdout)
    except ValueError:
        told = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        text, hint = told.removeprefix(f"{FLEET_PROGRAM}: "), "see: litegripd-fleet check"
        if done.returncode == WRONG_USAGE:
            return run.refuse(text, hint)
        if done.returncode == _NO_NETWORK:
            raise ConnectError(text, reason="unreachable", data={"hint": hint}) from None
        text = f"{FLEET_PROGRAM} has ended with {done.returncode}: {text}"
        raise ProtocolError(text, data={"hint": hint}) from None
    run.output.result(data, "")
    return done.returncode


COMMANDS: Commands = {"fleet": (fleet, fleet_options)}
