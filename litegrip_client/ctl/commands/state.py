"""Commands about the state and the clients: show them, stop the gripper, take its lease."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Iterator
from functools import partial
from itertools import chain, islice

from litegrip_client.core.discovery import is_socket_given, socket_paths
from litegrip_client.core.sockets import SOCKET_VARIABLE, STOP_LEVELS, is_reached
from litegrip_client.core.stop import is_taken_as_meant, stop_at, stop_params, stop_within_s
from litegrip_client.ctl import render
from litegrip_client.ctl.parser import LateParser, count, in_unit, positive
from litegrip_client.ctl.run import (
    NOT_OK,
    OK,
    Commands,
    Output,
    Run,
    confirm,
    connected,
    installing,
    may_ask,
    samples,
)
from litegrip_client.ctl.state_view import state_line, state_text, stopped
from litegrip_client.values.errors import CommandError, ConnectError, LiteGripError
from litegrip_client.values.figures import Data, figure, owner, plain
from litegrip_client.values.printed import aligned


def clients(run: Run) -> int:
    """List who is connected, and what each has cost; this program is marked."""
    data = run.connection.call("clients.list")
    table = [("CLIENT", "ROLE", "REQUESTS", "REFUSED", "DROPPED", "WORST", "CONNECTED")]
    table += [
        (
            plain(owner(row)) + (" (this one)" if row.get("is_me") else ""),
            plain(row.get("role")),
            str(row.get("requests")),
            str(row.get("refused")),
            str(row.get("dropped")),
            figure(row.get("worst_latency_ms"), ".1f", "ms"),
            figure(row.get("connected_s"), ".0f", "s"),
        )
        for row in data["clients"]
    ]
    return run.done(data, aligned(table))


_TAKE = """\
End somebody's lease, and with it the motion that runs; the gripper is nobody's
then. The jaws keep holding what they hold, whatever the loser had chosen. On a
terminal it asks first.
"""


def lease_options(parser: LateParser) -> None:
    """Add the arguments of `lease`."""
    parser.description = "Show who has the gripper to itself. Without an action, just that."
    actions = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser)
    actions.add_parser("show", help="show it")
    actions.add_parser(
        "take", help="end somebody's lease, and with it its motion", fill=_take_options
    )


def _take_options(parser: LateParser) -> None:
    parser.description = _TAKE
    parser.add_argument("why", metavar="REASON", help="for the loser and the log")
    parser.add_argument(
        "--release", action="store_true", help="let go of what is held: the jaws go slack"
    )
    parser.add_argument("-y", "--yes", action="store_true", help="do not ask first")


def lease(run: Run) -> int:
    """Show who has the gripper to itself, or take it away."""
    if run.options.action == "take":
        return _take(run)
    data = run.connection.call("lease.get")
    return run.done(data, render.lease(data))


def _take(run: Run) -> int:
    options, connection = run.options, run.connection
    before = connection.call("lease.get")
    holder = before["owner"]
    if not options.yes and may_ask():
        whose = connection.call("state.get").get("job") if holder is None else holder
        if whose is not None:
            what = render.lease(before)
            if holder is None:
                by = owner(whose.get("owner") or {})
                what = f"job {whose.get('job')}, {whose.get('kind')} by {by}, is running"
            then = "go slack" if options.release else "hold on"
            if not confirm(plain(f"{what}; end that? The jaws {then} then.")):
                run.output.error(CommandError("nothing was done", reason="not_wanted"), "")
                return NOT_OK
    params = {"why": options.why, "purpose": "litegripctl"}
    taken = connection.call("lease.take", params | ({"jaws": "relax"} if options.release else {}))
    connection.call("lease.release")
    ended, state = taken.get("ended_job"), taken["state"]
    text = "nobody had it before" if holder is None else f"taken from {owner(holder)}"
    text += "" if ended is None else f", job {ended} was ended"
    data = {"taken_from": holder, "ended_job": ended, "state": state}
    return run.done(data, plain(f"{text}; {_jaws(state)}; the lease is free now"))


def _jaws(state: Data) -> str:
    """Return what the jaws do after a take-over."""
    if state.get("mode") == "relaxed":
        return "the jaws are slack"
    if state.get("mode") != "holding":
        return f"the gripper is {state.get('mode')}"
    force_n = state.get("force_set_n")
    by = "" if force_n is None else f", with {figure(force_n, '.1f', 'N')}"
    return f"the jaws hold on{by}"


def not_stopped(error: LiteGripError, options: Namespace) -> None:
    """Have a stop's error say first that nobody knows of the stop, and what to do; as the page."""
    whom = options.channel
    if options.socket is not None:
        whom = options.socket
    elif is_socket_given() and not options.channel_chosen:
        whom = os.environ[SOCKET_VARIABLE]
    how = "did not reach" if error.reason == "no_daemon" else "not confirmed by"
    error.message = f"STOP {how} {whom}. Cut the motor's power. Why: {error.message}"


def stop_first(options: Namespace, output: Output) -> int | None:
    """Stop by the stop socket; return the exit code, None if there was no such socket.

    A daemon that serves none is stopped as by any other request, and so for too long a reason.
    """
    if not is_taken_as_meant(stop_params(options.level, options.why)):
        return None
    limit_s = stop_within_s(options.channel, options.socket)
    for path in socket_paths(options.channel, options.socket):
        try:
            data = stop_at(path, options.level, options.why, limit_s)
        except ConnectError:
            raise
        except OSError:  # nobody listens for stops there, or not to this user
            continue  # the other socket then says so
        return Run(None, options, output).done(
            data, stopped(data, options.here), ok=is_reached(data)
        )
    return None


def stop_options(parser: LateParser) -> None:
    """Add the arguments of `stop`."""
    parser.add_argument(
        "--level",
        choices=STOP_LEVELS,
        default="hold",
        help="hold the position (default), let go, or disable the motor",
    )
    parser.add_argument(
        "--all", action="store_true", help="stop every gripper of this machine, at the same time"
    )
    parser.add_argument("--why", metavar="TEXT", help="shown to clients that the stop refuses")


def stop(run: Run) -> int:
    """Latch a stop by the socket of all requests."""
    data = run.connection.call("stop", stop_params(run.options.level, run.options.why))
    return run.done(data, stopped(data, run.here), ok=is_reached(data))


def clear(run: Run) -> int:
    """Clear a stop."""
    data = run.connection.command("stop.clear", {})
    state = data.get("state") or {}
    had_none = data.get("cleared", "of an older daemon") is None
    text = f"{'no stop was latched' if had_none else 'cleared'}: motions are allowed"
    if state.get("enabled") is not True:
        motor = {"silent": "does not answer", "fault": "reports a fault"}.get(
            state.get("motor", ""), f"is {plain(state.get('motor'))}"
        )
        text += f", once the motor is enabled (it {motor})"
    return run.done(data, text)


def state(run: Run) -> int:
    """Show the state."""
    data = run.connection.call("state.get")
    return run.done(data, state_text(data, run.here))


_WATCH = """\
Show the state again and again, until Ctrl-C. In a terminal this is a live view
of the whole gripper, with a trace of the last minute, which waits for a daemon
that goes; q ends it. It needs the library rich: pip install rich. Elsewhere,
and with --plain, a line for each state.
"""


def watch_options(parser: LateParser) -> None:
    """Add the arguments of `watch`."""
    parser.description = _WATCH
    parser.add_argument(
        "--hz",
        type=in_unit(positive, "Hz", "0.1 to 200"),
        default=5.0,
        metavar="N",
        help="0.1 to 200 (5)",
    )
    parser.add_argument("--count", type=count, metavar="N", help="end after N states")
    parser.add_argument(
        "--plain", action="store_true", help="lines, and no live view, in a terminal as well"
    )


def watch(run: Run) -> int:
    """Show states until the count is reached or Ctrl-C is pressed."""
    options = run.options
    if options.plain or not run.output.live or os.environ.get("TERM", "dumb") == "dumb":
        return _lines(run)
    try:
        from litegrip_client.ctl import live  # noqa: PLC0415 - needs the extra
    except ModuleNotFoundError as error:
        text = f"lines only: the live view needs the library {error.name}: {installing('rich')}"
        run.output.note(text)
        return _lines(run)
    last: list[live.Scene] = []

    def counted() -> Iterator[live.Scene]:
        scenes = live.scenes(partial(connected, options), run.connection, options.hz)
        for scene in islice(scenes, options.count):
            last[:] = [scene]
            yield scene

    name = str(run.connection.call("hello")["channel"])
    try:
        live.show(counted(), name, run.here)
    finally:
        for scene in last:
            if scene.state is not None:  # the view itself leaves nothing in the terminal
                run.output.result(scene.state, state_line(scene.state, run.here))
    return OK


def _lines(run: Run) -> int:
    """Show a line for each state, on a terminal, too; of a daemon that hangs say so."""
    from litegrip_client.line.exchange import not_answered  # noqa: PLC0415 - takes long to import

    count, most = 0, run.options.count
    for state, silent_s in samples(run.connection, run.options.hz):
        if state is None:
            run.output.note(not_answered(silent_s))
            continue
        run.output.result(state, state_line(state, run.here))
        count += 1
        if count == most:
            break
    return OK


_EVENTS = """\
Show the latest events, the oldest first, and with --follow all that come, until
Ctrl-C. Without --kind these are all kinds but refused, which reports requests
of other clients that were refused.
"""


def events_options(parser: LateParser) -> None:
    """Add the arguments of `events`."""
    parser.description = _EVENTS
    parser.add_argument("-f", "--follow", action="store_true", help="continue until Ctrl-C")
    parser.add_argument(
        "--kind", action="append", metavar="KIND", help="only these; may be given again"
    )
    parser.add_argument(
        "-n", "--last", type=count, metavar="N", help="of those before, the latest N (default: all)"
    )


def events(run: Run) -> int:
    """Show events."""
    from dataclasses import asdict  # noqa: PLC0415 - takes long to import

    clock = render.clock_of(run.connection)
    with run.connection.subscribe_events(run.options.kind) as events:
        before = events.recent[-(run.options.last or len(events.recent)) :]
        for event in chain(before, events if run.options.follow else ()):
            text = plain(event.message)
            run.output.result(asdict(event), f"{clock(event.monotonic_s)}  {text}")
    return OK


COMMANDS: Commands = {
    "events": (events, events_options),
    "clients": (clients, None),
    "lease": (lease, lease_options),
    "stop": (stop, stop_options),
    "clear": (clear, None),
    "state": (state, None),
    "watch": (watch, watch_options),
}
