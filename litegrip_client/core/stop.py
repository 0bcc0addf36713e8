"""The stop, which goes by the daemon's own socket for stops: no flood of requests delays it.

It is a software stop all the same: no replacement for the switch that cuts the power.
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Mapping

from litegrip_client.core.discovery import is_socket_given
from litegrip_client.core.sockets import NOT_REACHED, STOP_LEVELS, is_reached, stop_path
from litegrip_client.line.exchange import request_line
from litegrip_client.values.errors import (
    CANTimeoutError,
    ConnectError,
    LiteGripError,
    ProtocolError,
    from_error_object,
)

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.session import DaemonSession, Wire

WHY_CHARACTERS = 80
"""So many of a stop's reason are shown by the daemon."""
_MAX_ANSWER_BYTES = 65_536
_MAX_REQUEST_BYTES = 1024

STOP_WITHIN_S = 1.0
"""Stops are served in every tick. Who has no answer by then is stopped by a request as well, which
waits as long: who stops must hear in time that the stop is not confirmed."""
FAR_STOP_WITHIN_S = 2.5
"""A portal reports after 2 s that a stop is not confirmed, and says what to do then."""


def stop_within_s(channel: str, socket_path: str | None) -> float:
    """Return how long a stop may go without an answer: a hung daemon is told soon.

    What is behind a socket that was named may be as far away as what has a dot in its name.
    """
    is_far = "." in channel or is_socket_given(socket_path)
    return FAR_STOP_WITHIN_S if is_far else STOP_WITHIN_S


def stop_params(level: str, why: str | None) -> dict[str, str]:
    """Return the parameters of a stop."""
    return {"level": level} if why is None else {"level": level, "why": why}


def is_taken_as_meant(params: Mapping[str, Any]) -> bool:
    """Return True if the stop socket understands these parameters; it takes others for a hold."""
    why = params.get("why")
    if params.get("level") not in STOP_LEVELS or not (why is None or isinstance(why, str)):
        return False
    return len(request_line(1, "stop", params)) <= _MAX_REQUEST_BYTES


def stop_at(path: str, level: str, why: str | None, timeout_s: float) -> dict[str, Any]:
    """Stop the gripper whose daemon listens at `path`; return the latched level and the generation.

    Raises `OSError` when nobody listens for stops there, `ConnectError` when the answer does not
    come in time: the stop may be in force then all the same.
    """
    request = request_line(1, "stop", stop_params(level, why))
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connected:
        connected.settimeout(timeout_s)
        connected.connect(stop_path(path))
        received = b""
        try:
            connected.sendall(request)
            while not received.endswith(b"\n") and len(received) < _MAX_ANSWER_BYTES:
                piece = connected.recv(_MAX_ANSWER_BYTES)
                if not piece:
                    break
                received += piece
        except OSError as error:
            why = f" within {timeout_s:g} s" if isinstance(error, TimeoutError) else f": {error}"
            text = f"the stop was sent, but its answer did not come{why}; it may come into force"
            raise ConnectError(f"{text} later", reason="connection_lost") from error
    return _result(received)


def _result(received: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(received)
        error = answer.get("error")
        result: dict[str, Any] = answer["result"] if error is None else {}
    except (ValueError, KeyError, TypeError, AttributeError) as problem:
        text = f"the daemon answered the stop with {received[:80]!r}"
        raise ProtocolError(text) from problem
    if error is not None:
        raise from_error_object(error)
    return result


async def stop(session: DaemonSession, params: dict[str, str]) -> dict[str, Any]:
    """Stop; return the latched level, the generation and the state after it.

    Where the session has no connection, as after a restart of the daemon, the stop connects by
    itself. The session's next requests know of it, whichever socket it went by. Raises
    `LiteGripError` if both sockets fail, or if the stop is in force and the state cannot be read,
    `CANTimeoutError` if it is latched, but the motor does not answer.
    """
    result: dict[str, Any] = {}
    if session.is_open:
        wire = session.wire

        async def give() -> None:
            try:
                limit_s = stop_within_s(session.chosen, session.socket_path)
                result.update(
                    await _by_stop_socket(session, wire, params, limit_s)
                    or await session.ask("stop", params, limit_s)
                )
            except ConnectError as error:
                if not wire.connection.closed:
                    danger = "the stop is not confirmed and may still act, cut the motor's power"
                    error.message = f"{danger}: {error.message}"
                    raise
            else:
                wire.connection.note_stops(result)

        await wire.finish(give)  # who cancels a stop on its way has stopped all the same
    if not result:
        result = await _anew(session, params)
    if "state" not in result:
        try:
            result["state"] = await _state(session)
        except LiteGripError as error:
            error.message = f"stopped ({result.get('level')}), but no state came: {error.message}"
            raise
    if not is_reached(result):
        text = f"a stop ({result['level']}) is latched, but {NOT_REACHED}"
        raise CANTimeoutError(text, reason="motor_silent")
    return result


async def _state(session: DaemonSession) -> dict[str, Any]:
    """Return the state, also where the connection has ended meanwhile.

    The stop itself ends it where another thread or task leaves its block by it.
    """
    try:
        return await session.ask("state.get")
    except ConnectError:
        if session.is_open:
            raise
    apart = await session.connect_apart()
    try:
        return await apart.call("state.get")
    finally:
        await apart.close()


async def _anew(session: DaemonSession, params: dict[str, str]) -> dict[str, Any]:
    """Stop by a connection of its own; return what came of it, and the state."""
    result: dict[str, Any] = {}
    try:
        apart = await session.connect_apart()
    except LiteGripError as error:  # the daemon of another gripper, too
        error.message = f"the stop is not confirmed, cut the motor's power: {error.message}"
        raise

    async def give() -> None:
        result.update(await apart.call("stop", params))
        with contextlib.suppress(LiteGripError):  # who asks for it then, says so
            result["state"] = await apart.call("state.get")

    try:
        await apart.finish(give)
    finally:
        await apart.close()
    return result


async def _by_stop_socket(
    session: DaemonSession, wire: Wire, params: dict[str, str], limit_s: float
) -> dict[str, Any] | None:
    """Stop by the socket that the daemon named; None where that did not work for sure.

    The path is the daemon's. Here, behind a forwarded socket or in a container, it may lead to
    the daemon of another gripper: so only to the very process that the session is connected to.
    """
    if wire.connection.stop_socket is None or not is_taken_as_meant(params):
        return None
    try:
        stops = await session.reach(wire.connection.stop_socket, limit_s)
    except OSError:
        return None
    try:
        pid = stops.connection.daemon_pid
        if pid == 0 or pid != wire.connection.daemon_pid:
            return None
        return await stops.call("stop", params)
    except LiteGripError:
        return None
    finally:
        await stops.close()
