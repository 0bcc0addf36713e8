"""What a gateway lets through to the daemon: each line with its age and its limits, or refused."""

import json
from collections.abc import Collection, Mapping
from typing import Any

from litegrip_client.values import strict_json
from litegrip_fleet.wire.answers import (
    INVALID_PARAMS,
    TOO_LATE,
    error_line,
    error_object,
    refused_line,
)
from litegrip_fleet.wire.daemon_lines import MAX_LINE_BYTES, TOO_LONG, is_id
from litegrip_fleet.wire.lateness import MOTION_COUNTS_S, SET_POINT_COUNTS_S, late_by

SHORTEST_TTL_S, LONGEST_TTL_S = 0.3, 5.0
"""Of a session, and of a lease that it asks for."""

MAX_CONTAINERS = 512
"""As the daemon's."""

_LEASES = frozenset({"lease.acquire", "lease.take"})
_REFUSED_AS = {"stream.set": "stream.refused", "teleop.receive": "teleop.refused"}
"""Set-points, with or without an id: how the refusal of one without is reported."""


class RefusedError(Exception):
    """A line that goes no further; `answer` is for who sent it, empty where nobody waits."""

    def __init__(self, answer: bytes) -> None:
        super().__init__()
        self.answer = answer


def passed(
    line: bytes,
    now_s: float,
    *,
    at_s: float | None,
    generation: int | None,
    ttl_s: float,
    voided: Collection[str],
    process: str,
) -> bytes:
    """Return a line as the daemon is to get it; raises `RefusedError`.

    `at_s` is when it was sent by the clock of this machine, `generation` the count of stops that
    the sender knew of. `voided` are the methods that a stop makes void: they are refused when they
    are late. A motion's `key` is made one of its `process`: for the daemon, all clients are one
    process, the gateway. A lease without a time to live, or with one that no network should have,
    does not pass. What is no request is the daemon's to refuse: it reads lines as this does. One
    that is too long, or would become too long here, is refused alone; at the daemon it would end
    the session. A message is one line: of two, none would be looked at, and so it would be with
    halves.
    """
    line = _one_line(line)
    request = _parsed(line)
    if request is None:
        return line
    method, params = request["method"], dict(request.get("params", {}))
    if method in voided:
        _check_age(request, method, at_s, now_s)
        if at_s is not None:
            params["sent_s"] = min(at_s, now_s)
        if generation is not None:
            params.setdefault("stop_generation", generation)
        if isinstance(params.get("key"), str):
            params["key"] = f"{process} {params['key']}"
    if method in _LEASES:
        params["ttl_s"] = _checked_ttl(request, params.get("ttl_s", ttl_s))
    if params == request.get("params", {}):
        return line
    try:
        text = json.dumps({**request, "params": params}, separators=(",", ":"), allow_nan=False)
    except ValueError:
        error = error_object(INVALID_PARAMS, f"{method}: a number is too large to be one")
        raise RefusedError(_answer(request, error)) from None
    longer = text.encode() + b"\n"
    if _is_too_long(longer):
        raise RefusedError(_answer(request, TOO_LONG))
    return longer


def may_ask_lease(line: bytes) -> bool:
    """Return False for what asks for no method that begins with `lease.`, however written."""
    return b'"lease.' in line or b"\\" in line


def asked_lease(line: bytes) -> tuple[bytes, bool] | None:
    """Return how the answer to a request for a lease begins, and if it names its time to live.

    None for any other line.
    """
    request = _parsed(line) if may_ask_lease(line) else None
    if request is None or request["method"] not in _LEASES:
        return None
    identity = json.dumps(request.get("id")).encode()
    answer = b'{"jsonrpc":"2.0","id":%b,' % identity  # as a daemon writes it
    return answer, "ttl_s" in request.get("params", {})


def _one_line(line: bytes) -> bytes:
    """Return the line of a message, with its newline; raises `RefusedError`."""
    if _is_too_long(line):
        raise RefusedError(error_line(None, TOO_LONG))
    line = line.removesuffix(b"\n")
    if b"\n" in line:
        error = error_object(INVALID_PARAMS, "a message of a portal is one line, this one is more")
        raise RefusedError(error_line(None, error))
    return line + b"\n"


def _is_too_long(line: bytes) -> bool:
    return len(line) > MAX_LINE_BYTES + len(b"\n")


def _parsed(line: bytes) -> Mapping[str, Any] | None:
    """Return a line's request; None for what is none, or takes long to read.

    The daemon refuses that, too. For it, blanks before a request are none.
    """
    if line.count(b"{") + line.count(b"[") > MAX_CONTAINERS:
        return None
    try:
        value = strict_json.decode(line.lstrip().decode())
    except (ValueError, RecursionError):
        return None
    if not isinstance(value, dict) or not isinstance(value.get("method"), str):
        return None
    return value if isinstance(value.get("params", {}), dict) else None


def _check_age(request: Mapping[str, Any], method: str, at_s: float | None, now_s: float) -> None:
    counts_s = SET_POINT_COUNTS_S if method in _REFUSED_AS else MOTION_COUNTS_S
    age_s = late_by(at_s, now_s, counts_s)
    if age_s is None:
        return
    age = "unknown" if age_s == float("inf") else f"{age_s:.2f} s"
    error = error_object(
        TOO_LATE,
        f"{method} came over the network too late to count: its age is {age}, {counts_s:g} s are"
        " allowed; it was not carried out",
        hint="look at the gripper's state, then send it again",
    )
    raise RefusedError(_answer(request, error))


def _checked_ttl(request: Mapping[str, Any], ttl_s: object) -> object:
    """Return the time to live that a lease is asked for with; raises `RefusedError`.

    What is no number is the daemon's to refuse.
    """
    if not isinstance(ttl_s, int | float) or SHORTEST_TTL_S <= ttl_s <= LONGEST_TTL_S:
        return ttl_s
    text = (
        f"{request['method']}: ttl_s is {ttl_s!r:.20}, over the network it must be"
        f" {SHORTEST_TTL_S:g} to {LONGEST_TTL_S:g}"
    )
    raise RefusedError(_answer(request, error_object(INVALID_PARAMS, text, parameter="ttl_s")))


def _answer(request: Mapping[str, Any], error: Mapping[str, Any]) -> bytes:
    """Return the line that reports a refusal: an answer, or a set-point's notification.

    What the daemon would not take as an id is not answered with.
    """
    if "id" in request:
        identity = request["id"]
        return error_line(identity if is_id(identity) else None, error)
    name = _REFUSED_AS.get(request["method"])
    return b"" if name is None else refused_line(name, error)
