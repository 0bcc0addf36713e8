"""Stop the gripper by the daemon's own socket for stops, else as by any other request.

This module must not know what a stop does.
"""

from __future__ import annotations

from litegrip_client.errors import LiteGripError
from litegrip_client.stopping import is_taken_as_meant

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.link import Link
    from litegrip_client.core.wire import Wire

STOP_WITHIN_S = 1.0
"""Stops are served in every tick. Who has no answer by then is stopped by a request as well."""


async def stop(link: Link, params: dict[str, str]) -> dict[str, Any]:
    """Stop; return the latched level, the generation and the state after it.

    What the link sends next knows of the stop, whichever way it went. Raises `LiteGripError`
    when both ways fail, or when the stop is in force and the state cannot be had.
    """
    wire = link.wire
    result: dict[str, Any] = {}

    async def give() -> None:
        result.update(await _by_stop_socket(link, wire, params) or await link.ask("stop", params))
        wire.note_stops(result)

    await wire.finish(give())  # who cancels a stop on its way has stopped all the same
    if "state" not in result:
        try:
            result["state"] = await link.ask("state.get")
        except LiteGripError as error:
            error.message = f"stopped ({result.get('level')}), but no state came: {error.message}"
            raise
    return result


async def _by_stop_socket(link: Link, wire: Wire, params: dict[str, str]) -> dict[str, Any] | None:
    """Stop by the socket that the daemon named; None where that did not work for sure.

    The path is the daemon's. Here, behind a forwarded socket or in a container, it may lead to
    the daemon of another gripper: so only to the very process that the link is connected to.
    """
    if wire.stop_socket is None or not is_taken_as_meant(params):
        return None
    try:
        stops = await link.reach(wire.stop_socket, STOP_WITHIN_S)
    except OSError:
        return None
    try:
        if stops.daemon_pid == 0 or stops.daemon_pid != wire.daemon_pid:
            return None
        return await stops.call("stop", params)
    except LiteGripError:
        return None
    finally:
        await stops.close()
