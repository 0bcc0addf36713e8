"""The program `litegripctl`: connect, run one command, and end with the right exit code."""

import io
import os
import sys
from argparse import Namespace

from litegrip_client.ctl.commands import find, needs_daemon
from litegrip_client.ctl.options import UsageError, parse
from litegrip_client.ctl.output import Output
from litegrip_client.ctl.run import CHOOSE_MOUNT, INTERRUPTED, OK, WRONG_USAGE, Run
from litegrip_client.ctl.way import Way, way_of
from litegrip_client.discovery import running_channels
from litegrip_client.errors import CommandError, LiteGripError, ProtocolError, exit_code

COMPLETE = "__complete"
"""What a shell's completion calls this program with, before the words so far."""

PIPE_CLOSED = 141
"""As the shell reports a program that SIGPIPE (13) ended: 128 + 13."""

# In this program's words; the daemon's hints are in those of the protocol.
_HINTS = {
    "stopped": "when it is safe again: litegripctl clear",
    "sent_before_stop": "when it is safe again: litegripctl clear, then once more",
    "not_enabled": "first: litegripctl enable",
    "not_calibrated": CHOOSE_MOUNT,
    "busy": "see: litegripctl jobs",
    "teleop_busy": "end it: litegripctl teleop stop",
    "teleop_not_ready": "see: litegripctl state; calibrate it, then: litegripctl enable",
    "lease_held": "see: litegripctl lease; in need: litegripctl lease take REASON",
    "unknown_job": "see: litegripctl jobs",
    "unknown_trajectory": "see: litegripctl trajectories",
    "trajectory_busy": "see: litegripctl jobs; what only watches ends with its client: clients",
    "unknown_method": "the daemon is older than this program: see 'litegripctl info'",
}


def main(arguments: list[str] | None = None) -> int:
    """Run `litegripctl`; return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without "°" is no reason to fail
    given = sys.argv[1:] if arguments is None else arguments
    if given[:1] == [COMPLETE]:
        return _complete(given[1:])
    try:
        options = parse(given)
    except UsageError as wrong:
        return _refuse(wrong, Output(as_json="--json" in given))
    output = Output(as_json=options.json)
    try:
        code = _run(options, output)
        sys.stdout.flush()
    except BrokenPipeError:
        _abandon_output()
        return PIPE_CLOSED
    return code


def _run(options: Namespace, output: Output) -> int:
    try:
        with way_of(options) as way:
            if options.command == "stop" and _stop_first(way, output):
                return OK
            command = find(options.command)
            if not needs_daemon(options):
                return command(Run(None, options, output, way))
            with way.connect() as connection:
                return command(Run(connection, options, output, way))
    except LiteGripError as error:
        output.error(error, _hint(error, options))
        return exit_code(error)
    except (KeyError, TypeError, AttributeError) as error:
        strange = ProtocolError(f"the daemon's answer is not as expected: {error!r}")
        output.error(strange, _hint(strange, options))
        return exit_code(strange)
    except KeyboardInterrupt:
        output.end_line()
        return INTERRUPTED


def _stop_first(way: Way, output: Output) -> bool:
    from litegrip_client.ctl.commands.clients import stop_first  # noqa: PLC0415 - see commands

    return stop_first(way, output)


def _complete(words: list[str]) -> int:
    from litegrip_client.ctl.completion import complete  # noqa: PLC0415 - seldom needed

    print("\n".join(complete(words)))
    return OK


def _refuse(wrong: UsageError, output: Output) -> int:
    """Say what is wrong with the command line."""
    if not output.as_json:
        sys.stderr.write(wrong.usage)
    output.error(CommandError(wrong.message, reason="wrong_usage"), "see: litegripctl --help")
    return WRONG_USAGE


def _hint(error: LiteGripError, options: Namespace) -> str:
    if error.reason == "no_daemon" and not options.channel_chosen and options.socket is None:
        running = running_channels()
        # Which of them is meant is not guessed: it may be the one that must not move. Where the
        # default's socket is there, it is known to be meant, and the error says what is wrong.
        if running and options.channel not in running:
            return f"there are: {', '.join(running)}; name one: litegripctl -c {running[0]} ..."
    own = _HINTS.get(error.reason or "") or error.hint
    if own:
        return own
    if error.reason == "internal_error":
        return f"see the daemon's log: journalctl -u litegripd@{options.channel}"
    return "try again" if error.retryable else "see: litegripctl --help"


def _abandon_output() -> None:
    # Else the interpreter, when it ends, complains that it cannot write what is left.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
