"""The errors that gateway and portal answer a client with, as the daemon would."""

import json
from collections.abc import Mapping
from typing import Any

INVALID_PARAMS = -32602
UNREACHABLE = -32060
TOO_LATE = -32061
TOO_MANY_CONNECTIONS = -32001
BACKLOG_FULL = -32003
LINE_TOO_LONG = -32000
"""Codes of the daemon's error table (docs/errors.md)."""

_REASONS = {
    INVALID_PARAMS: ("invalid_params", False),
    UNREACHABLE: ("unreachable", True),
    TOO_LATE: ("too_late", True),
    TOO_MANY_CONNECTIONS: ("too_many_connections", True),
    BACKLOG_FULL: ("backlog_full", True),
    LINE_TOO_LONG: ("line_too_long", False),
}


def error_object(code: int, message: str, **data: object) -> dict[str, Any]:
    """Return an error as JSON-RPC has it."""
    reason, retryable = _REASONS[code]
    return {
        "code": code,
        "message": message,
        "data": {"reason": reason, "retryable": retryable, **data},
    }


def error_line(identity: object, error: Mapping[str, Any]) -> bytes:
    """Return the line that answers a request with an error; without one, `identity` is None."""
    return _line({"jsonrpc": "2.0", "id": identity, "error": error})


def refused_line(name: str, error: Mapping[str, Any]) -> bytes:
    """Return the notification of a request without an id that was not taken."""
    return _line({"jsonrpc": "2.0", "method": name, "params": error})


def _line(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"
