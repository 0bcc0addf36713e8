"""The command that prints what a shell needs to complete command lines."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.ctl.completion.scripts import SCRIPTS
from litegrip_client.ctl.parser import LateParser
from litegrip_client.ctl.run import OK, Command, Fill, Run

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


def completion_options(parser: LateParser) -> None:
    """Take which shell."""
    parser.description, parser.epilog = _COMPLETION, _COMPLETION_EXAMPLES
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell")


def completion(run: Run) -> int:
    """Print the script of a shell."""
    shell = run.options.shell
    script = SCRIPTS[shell]
    run.output.result({"shell": shell, "script": script}, script.rstrip("\n"))
    return OK


COMMANDS: Mapping[str, Command] = {"completion": completion}
OPTIONS: Mapping[str, Fill] = {
    "completion": completion_options,
}
