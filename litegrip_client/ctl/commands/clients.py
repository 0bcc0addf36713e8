"""The commands that show who is there and who has the gripper, and that stop it or take it over."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.ctl import render
from litegrip_client.ctl.run import OK, Command, Run
from litegrip_client.discovery import socket_paths
from litegrip_client.errors import ConnectError
from litegrip_client.stopping import is_taken_as_meant, stop_at

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from argparse import Namespace
    from typing import Any

    from litegrip_client.ctl.output import Output

_STOP_WITHIN_S = 2.0


def clients(run: Run) -> int:
    """List who is connected, and what each has cost."""
    data = run.connection.call("clients.list")
    run.output.result(data, render.clients(data["clients"]))
    return OK


def lease(run: Run) -> int:
    """Show who has the gripper to itself, or take it away."""
    if run.options.action == "take":
        return _take(run)
    data = run.connection.call("lease.get")
    run.output.result(data, render.lease(data))
    return OK


def _take(run: Run) -> int:
    before = run.connection.call("lease.get")["owner"]
    run.connection.call("lease.take", {"why": run.options.why, "purpose": "litegripctl"})
    run.connection.call("lease.release")
    text = "nobody had the lease" if before is None else f"taken from {render.owner(before)}"
    run.output.result({"taken_from": before}, render.plain(f"{text}: the gripper is free"))
    return OK


def stop_first(options: Namespace, output: Output) -> bool:
    """Stop by the socket that is served first; tell whether there was one.

    A daemon that serves none is stopped as by any other request, and so for too long a reason.
    """
    if not is_taken_as_meant(_params(options)):
        return False
    for path in socket_paths(options.channel, options.socket):
        try:
            data = stop_at(path, options.level, options.why, _STOP_WITHIN_S)
        except ConnectError:  # is an OSError, too; this stop may have been heard
            raise
        except OSError:  # who may not come in by the other socket either is told so there
            continue
        output.result(data, stopped(data))
        return True
    return False


def stop(run: Run) -> int:
    """Latch a stop by the socket of all requests."""
    data = run.connection.call("stop", _params(run.options))
    run.output.result(data, stopped(data))
    return OK


def _params(options: Namespace) -> dict[str, str]:
    return {"level": options.level} | ({} if options.why is None else {"why": options.why})


def stopped(data: Mapping[str, Any]) -> str:
    """Tell that a stop is latched."""
    return render.plain(f"stopped: {data['level']}, until: litegripctl clear")


COMMANDS: Mapping[str, Command] = {"clients": clients, "lease": lease, "stop": stop}
