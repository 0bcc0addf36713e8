"""The commands that show who is there and who has the gripper, take it over, stop and clear it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from litegrip_client.ctl import render
from litegrip_client.ctl.output import confirm, may_ask
from litegrip_client.ctl.parser import LateParser
from litegrip_client.ctl.run import NOT_OK, OK, Commands, Run
from litegrip_client.errors import CommandError
from litegrip_client.stopping import is_taken_as_meant, stop_at

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from argparse import Namespace
    from typing import Any

    from litegrip_client.ctl.output import Output
    from litegrip_client.ctl.run import Way

_STOP_WITHIN_S = 2.0


def clients(run: Run) -> int:
    """List who is connected, and what each has cost."""
    data = run.connection.call("clients.list")
    run.output.result(data, _clients_text(data["clients"]))
    return OK


def _clients_text(rows: list[render.Data]) -> str:
    """Show who is connected as a table; the asking program itself is marked."""
    table = [("CLIENT", "ROLE", "REQUESTS", "REFUSED", "DROPPED", "WORST", "CONNECTED")]
    table += [
        (
            render.plain(render.owner(row)) + (" (this one)" if row.get("is_me") else ""),
            render.plain(row.get("role")),
            str(row.get("requests")),
            str(row.get("refused")),
            str(row.get("dropped")),
            render.figure(row.get("worst_latency_ms"), ".1f", "ms"),
            render.figure(row.get("connected_s"), ".0f", "s"),
        )
        for row in rows
    ]
    return render.aligned(table)


_TAKE = """\
End somebody's lease, and with it the motion that runs; the gripper is nobody's
then. The jaws go on holding what they hold, whatever the loser wished. On a
terminal it asks first.
"""


def lease_options(parser: LateParser) -> None:
    """Take what to do."""
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
    run.output.result(data, render.lease(data))
    return OK


def _take(run: Run) -> int:
    options, connection = run.options, run.connection
    before = connection.call("lease.get")
    owner = before["owner"]
    if not options.yes and may_ask():
        whose = connection.call("state.get").get("job") if owner is None else owner
        if whose is not None and not confirm(_question(before, whose, options)):
            run.output.error(CommandError("nothing was done", reason="not_wanted"), "")
            return NOT_OK
    params = {"why": options.why, "purpose": "litegripctl"}
    taken = connection.call("lease.take", params | ({"jaws": "relax"} if options.release else {}))
    connection.call("lease.release")
    ended, state = taken.get("ended_job"), taken["state"]
    text = "nobody had the lease" if owner is None else f"taken from {render.owner(owner)}"
    text += "" if ended is None else f", job {ended} was ended"
    data = {"taken_from": owner, "ended_job": ended, "state": state}
    run.output.result(data, render.plain(f"{text}; {_jaws(state)}; nobody has the lease now"))
    return OK


def _question(before: Mapping[str, Any], whose: Mapping[str, Any], options: Namespace) -> str:
    if before["owner"] is None:
        by = render.owner(whose.get("owner") or {})
        what = f"job {whose.get('job')}, {whose.get('kind')} by {by}, is running"
    else:
        what = render.lease(before)
    then = "go slack" if options.release else "hold on"
    return render.plain(f"{what}; end that? The jaws {then} then.")


def _jaws(state: Mapping[str, Any]) -> str:
    """Show what the jaws do after a take-over."""
    if state.get("mode") == "relaxed":
        return "the jaws are slack"
    if state.get("mode") != "holding":
        return f"the gripper is {state.get('mode')}"
    force_n = state.get("force_set_n")
    by = "" if force_n is None else f", with {render.figure(force_n, '.1f', 'N')}"
    return f"the jaws hold on{by}"


def stop_first(way: Way, output: Output) -> bool:
    """Stop by the stop socket; return True if there was one.

    A daemon that serves none is stopped as by any other request, and so for too long a reason.
    """
    options = way.options
    if not is_taken_as_meant(_params(options)):
        return False
    for path in way.paths():
        with suppress(*way.not_listening):
            data = stop_at(path, options.level, options.why, _STOP_WITHIN_S)
            output.result(data, stopped(data))
            return True
    return False


def stop_options(parser: LateParser) -> None:
    """Take what stopping means."""
    parser.add_argument(
        "--level",
        choices=("hold", "relax", "disable"),
        default="hold",
        help="hold the position (default), let go, or disable the motor",
    )
    parser.add_argument("--why", metavar="TEXT", help="shown to clients that the stop refuses")


def stop(run: Run) -> int:
    """Latch a stop by the socket of all requests."""
    data = run.connection.call("stop", _params(run.options))
    run.output.result(data, stopped(data))
    return OK


def _params(options: Namespace) -> dict[str, str]:
    return {"level": options.level} | ({} if options.why is None else {"why": options.why})


def stopped(data: Mapping[str, Any]) -> str:
    """Show that a stop is latched."""
    return render.plain(f"stopped: {data['level']}, until: litegripctl clear")


def clear(run: Run) -> int:
    """Clear a stop."""
    data = run.connection.run(run.connection.prepare_guarded("stop.clear", {}))
    run.output.result(data, "cleared: motions are allowed")
    return OK


COMMANDS: Commands = {
    "clients": (clients, None),
    "lease": (lease, lease_options),
    "stop": (stop, stop_options),
    "clear": (clear, None),
}
