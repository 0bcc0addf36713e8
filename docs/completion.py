"""The scripts by which bash, zsh and fish complete litegripctl: made by shtab from its parsers.

They are static: no shell asks the program or the daemon. Only the running channels are looked up.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import shtab

from litegrip_client.core.sockets import SYSTEM_DIRECTORY
from litegrip_client.ctl.commands import COMMANDS
from litegrip_client.ctl.parser import LateParser, Parser, whole_parser
from litegrip_client.values.motion_config import DAEMON_FIELDS

if TYPE_CHECKING:
    from argparse import Action

_RUNNING = f"ls {SYSTEM_DIRECTORY} $XDG_RUNTIME_DIR/litegripd 2>/dev/null"
_CHANNELS = f"{_RUNNING} | grep -v stop.sock | sed -n s/.sock//p"

COMPLETERS: Mapping[str, shtab.CompleteType] = {
    # Else zsh would list them when it loads the script, and never again.
    "channel": {**shtab.cmd(_CHANNELS), "zsh": rf"{{compadd -- \$({_CHANNELS})}}"},
    "PATH": shtab.FILE,
    "FILE": shtab.FILE,
    "FILE|NAME": shtab.FILE,
    "NAME|FILE": shtab.FILE,
    "PNG": shtab.FILE,
    "DIR": shtab.DIRECTORY,
    "normal|reverse|FILE": {
        "bash": "_litegripctl_template_or_file",
        "zsh": "{compadd normal reverse; _files}",
        "fish": "normal reverse (__fish_complete_path (commandline -ct))",
        "preamble": {
            "bash": "_litegripctl_template_or_file() {\n"
            '  compgen -W "normal reverse" -- "$1"\n'
            '  compgen -f -- "$1"\n'
            "}"
        },
    },
}
"""What completes an argument, by its metavar, or by its name where it has none."""

_FIELDS = list(DAEMON_FIELDS)
CHOICES = {"FIELD": _FIELDS, "FIELD=VALUE": [f"{name}=" for name in _FIELDS]}
"""Words for arguments whose values only the daemon checks, by their metavars."""


def completion_script(shell: str) -> str:
    """Make the script of a shell."""
    parser = whole_parser(COMMANDS)
    _prepare(parser)
    return shtab.complete(parser, shell).rstrip("\n") + "\n"


def _prepare(parser: Parser) -> None:
    """Make all parsers below this one, and mark what completes their arguments."""
    for action in parser.arguments():
        if isinstance(action.choices, Mapping):
            for text in action._get_subactions():  # type: ignore[attr-defined]  # noqa: SLF001
                inner: LateParser = action.choices[text.dest]
                inner.become()
                inner.description = text.help  # one line: shells show no more of a text
                _prepare(inner)
        else:
            _mark(action)


def _mark(action: "Action") -> None:
    name = str(action.metavar or action.dest)
    if name in COMPLETERS:
        action.complete = COMPLETERS[name]  # type: ignore[attr-defined] # where shtab looks
    elif name in CHOICES:
        action.choices = CHOICES[name]
