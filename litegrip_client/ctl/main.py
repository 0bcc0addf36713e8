"""The program `litegripctl`: connect, run one command, and end with the right exit code."""

import io
import os
import sys
from argparse import Namespace
from functools import partial

from litegrip_client.ctl.commands import COMMANDS, find, needs_daemon
from litegrip_client.ctl.parser import UsageError, for_gripper, parse
from litegrip_client.ctl.render import hint_for
from litegrip_client.ctl.run import (
    INTERRUPTED,
    OK,
    WRONG_USAGE,
    Output,
    OutputLostError,
    Run,
    connected,
)
from litegrip_client.values.errors import CommandError, LiteGripError, ProtocolError, exit_code

OUTPUT_LOST = 74
"""EX_IOERR of sysexits.h: what was to be said cannot be written."""

PIPE_CLOSED = 141
"""As the shell reports a program that SIGPIPE (13) ended: 128 + 13."""


def main(arguments: list[str] | None = None) -> int:
    """Run `litegripctl`; return its exit code."""
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without "°" is no reason to fail
    given = sys.argv[1:] if arguments is None else arguments
    try:
        options = parse(given, COMMANDS)
    except UsageError as wrong:
        return _refuse(wrong, Output(as_json="--json" in given))
    output = Output(as_json=options.json, for_gripper=partial(for_gripper, options.call, COMMANDS))
    try:
        code = _run(options, output)
        sys.stdout.flush()
    except BrokenPipeError:
        _abandon_output()
        return PIPE_CLOSED
    except OutputLostError as lost:
        _abandon_output()
        Output(as_json=False).note(f"standard output cannot be written: {lost}")
        return OUTPUT_LOST
    return code


def _run(options: Namespace, output: Output) -> int:
    try:
        if options.command == "stop" and _stop_first(options, output):
            return OK
        command = find(options.command)
        if not needs_daemon(options):
            return command(Run(None, options, output))
        with connected(options) as connection:
            return command(Run(connection, options, output))
    except LiteGripError as error:
        output.error(error, hint_for(error, options))
        return exit_code(error)
    except (KeyError, TypeError, AttributeError) as error:
        strange = ProtocolError(f"the daemon's answer is not as expected: {error!r}")
        output.error(strange, hint_for(strange, options))
        return exit_code(strange)
    except KeyboardInterrupt:
        output.end_line()
        return INTERRUPTED


def _stop_first(options: Namespace, output: Output) -> bool:
    from litegrip_client.ctl.commands.state import stop_first  # noqa: PLC0415 - see commands

    return stop_first(options, output)


def _refuse(wrong: UsageError, output: Output) -> int:
    """Report what is wrong with the command line."""
    if not output.as_json:
        sys.stderr.write(wrong.usage)
    hint = f"see: {wrong.program} --help"
    output.error(CommandError(wrong.message, reason="wrong_usage"), hint)
    return WRONG_USAGE


def _open_closed_streams() -> None:
    """Open /dev/null for each closed stream (`>&-`); else a socket would get its number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 - for good


def _abandon_output() -> None:
    # Else the interpreter, when it ends, complains that it cannot write what is left.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
