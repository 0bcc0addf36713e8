"""The command that prints what a shell needs to complete command lines."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.ctl.completion.scripts import SCRIPTS
from litegrip_client.ctl.run import OK, Command, Run


def completion(run: Run) -> int:
    """Print the script of a shell."""
    shell = run.options.shell
    script = SCRIPTS[shell]
    run.output.result({"shell": shell, "script": script}, script.rstrip("\n"))
    return OK


COMMANDS: Mapping[str, Command] = {"completion": completion}
