"""The whole of `litegripctl`: connect, run one command, and end with the right exit code."""

import json
import signal
import sys
from argparse import Namespace
from threading import Thread

from litegrip_client.core.discovery import served_channels
from litegrip_client.core.stop import stop_within_s
from litegrip_client.ctl.commands import COMMANDS, find, needs_daemon
from litegrip_client.ctl.commands.state import not_stopped, stop_first
from litegrip_client.ctl.parser import UsageError, meant_stop, parse, sounds_like_stop
from litegrip_client.ctl.render import hint_for, names_remedy
from litegrip_client.ctl.run import (
    INTERRUPTED,
    NO_DAEMON,
    NOT_OK,
    OK,
    WRONG_USAGE,
    KeptOutput,
    Output,
    Run,
    connected,
    take_the_only,
)
from litegrip_client.line.exchange import DEFAULT_TIMEOUT_S
from litegrip_client.values.errors import CommandError, LiteGripError, ProtocolError, exit_code
from litegrip_client.values.figures import PROGRAM


def run(given: list[str]) -> int:
    """Run a command line; return its exit code. Raises what standard output raises."""
    try:
        options = parse(given, COMMANDS)
    except UsageError as wrong:
        return _refuse(wrong, given)
    output = Output(as_json=options.json)
    return _run(options, output)


def _run(options: Namespace, output: Output) -> int:
    try:
        if options.command == "stop" and options.all:
            return _stop_all(options, output)
        if options.command == "stop":
            take_the_only(options)
            code = stop_first(options, output)
            if code is not None:
                return code
        command = find(options.command)
        if not needs_daemon(options):
            _raise_interrupts()
            return command(Run(None, options, output))
        limit_s = DEFAULT_TIMEOUT_S
        if options.command == "stop":
            limit_s = stop_within_s(options.channel, options.socket)
        with connected(options, limit_s) as connection:
            _raise_interrupts()
            return command(Run(connection, options, output))
    except LiteGripError as error:
        return _fail(error, options, output)
    except (KeyError, TypeError, AttributeError) as error:
        strange = ProtocolError(f"the daemon's answer is not as expected: {error!r}")
        return _fail(strange, options, output)
    except KeyboardInterrupt:
        output.end_line()
        return INTERRUPTED


def _stop_all(options: Namespace, output: Output) -> int:
    """Stop each gripper of this machine, at the same time; return the worst of the exit codes."""
    channels = [name for name in served_channels() if "." not in name]  # those are of others
    if not channels:
        text = "STOP reached nothing: no daemon runs on this machine. Cut the motor's power"
        output.error(CommandError(text, reason="no_daemon"), "")
        return NO_DAEMON
    why = [] if options.why is None else [f"--why={options.why}"]
    kept = [KeptOutput(as_json=output.as_json) for _ in channels]
    codes: dict[str, int] = {}

    def stop(channel: str, own: Output) -> None:
        command = ["--channel", channel, "stop", "--level", options.level, *why]
        codes[channel] = _run(parse(command, COMMANDS), own)

    _raise_interrupts()  # which only the main thread can
    threads = [Thread(target=stop, args=both) for both in zip(channels, kept, strict=True)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if output.as_json:
        told = {name: json.loads(own.written) for name, own in zip(channels, kept, strict=True)}
        output.result(told, "")
    else:
        for name, own in zip(channels, kept, strict=True):
            output.warn(own.warned)
            output.write("".join(f"{name}: {line}\n" for line in own.written.splitlines()))
    return max(codes.get(name, NOT_OK) for name in channels)


def _raise_interrupts() -> None:
    """Have Ctrl-C raised: there may be something to cancel now, or to put in order."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _fail(error: LiteGripError, options: Namespace, output: Output) -> int:
    """Report an error and what to do."""
    hint, is_said = hint_for(error, options), names_remedy(error)
    if options.command == "stop":
        not_stopped(error, options)
    output.error(error, hint, is_said=is_said)
    return exit_code(error)


def _refuse(wrong: UsageError, given: list[str]) -> int:
    """Report what is wrong with the command line; stop first, where that is what it means."""
    output = Output(as_json="--json" in given)
    stop = meant_stop(given, COMMANDS)
    if stop is not None:
        code = _run(stop, output)
        if code not in (OK, NOT_OK):
            return code  # it says what is to be done now
        whom = "each gripper" if stop.all else stop.channel
        wrong.message += f"; {whom} was told to stop ({stop.level}) all the same"
    elif sounds_like_stop(given):
        wrong.message += f"; nothing was stopped: say {PROGRAM} stop"
    if not output.as_json:
        sys.stderr.write(wrong.usage)
    hint = f"see: {wrong.program} --help"
    output.error(CommandError(wrong.message, reason="wrong_usage"), hint)
    return WRONG_USAGE
