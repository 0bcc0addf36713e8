"""One request on its way: what it says, and the inbox for what comes back.

No I/O here.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Mapping

from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeAlias

MAX_LINE_BYTES = 16_384
"""A longer line makes the daemon close the connection."""

Message: TypeAlias = "dict[str, Any]"
Progress: TypeAlias = "Callable[[Message], None]"

_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
_quote = json.encoder.encode_basestring_ascii


class Call:
    """One request, to be given to `run` of a connection once.

    `inbox` gets its progress notifications and then its answer. `job` is the number of the job
    that it started, once a notification names it; `answered` whether the answer has come, and
    `result` what it holds, if it is no error. `on_result` is called with the result where it is
    read, before anything behind it is read.
    `keep` makes that `answered` is still kept up to date after an interrupt, until
    `forget`.
    """

    __slots__ = (
        "answered",
        "identity",
        "inbox",
        "job",
        "keep",
        "method",
        "on_progress",
        "on_result",
        "params",
        "result",
    )

    def __init__(
        self,
        identity: int,
        method: str,
        params: Mapping[str, Any] | None = None,
        on_progress: Progress | None = None,
    ) -> None:
        self.identity = identity
        self.method = method
        self.params = params
        self.on_progress = on_progress
        self.on_result: Progress | None = None
        self.inbox: deque[Message] = deque()
        self.answered = False
        self.keep = False
        self.job: int | None = None
        self.result: Message | None = None

    def line(self) -> bytes:
        """Return the request as it is sent; raises `CommandError` when it cannot be."""
        return request_line(self.identity, self.method, self.params)


def request_line(identity: int | None, method: str, params: Mapping[str, Any] | None) -> bytes:
    """Return a request as it is sent; `identity` None makes it one that gets no answer.

    Raises `CommandError` when it cannot be sent.
    """
    try:
        tail = f',"params":{_encode(params)}' if params else ""
    except (ValueError, TypeError, RecursionError) as error:
        raise _unsendable(f"{method}: a parameter is not JSON: {error}") from error
    number = "" if identity is None else f'"id":{identity},'
    line = f'{{"jsonrpc":"2.0",{number}"method":{_quote(method)}{tail}}}\n'.encode()
    if len(line) > MAX_LINE_BYTES:
        text = f"{method}: the request is {len(line)} bytes long, {MAX_LINE_BYTES} at most"
        raise _unsendable(text)
    return line


def guarded(
    params: Mapping[str, Any], stop_generation: int | None, *, has_clock: bool
) -> dict[str, Any]:
    """Add to `params` when they were sent and of which stop their sender knew.

    For what must never run after a stop that comes before the daemon reads it. The time says
    something only where the daemon's clock can be read: `has_clock`.
    """
    guards: dict[str, Any] = {"sent_s": time.monotonic()} if has_clock else {}
    if stop_generation is not None:
        guards["stop_generation"] = stop_generation
    return {**params, **guards}


def generation_of(result: Mapping[str, Any]) -> int | None:
    """Find the stop generation in whatever result or error data holds one."""
    state = result.get("state")
    for holder, key in (
        (result, "stop_generation"),
        (result, "generation"),
        (state, "stop_generation"),
    ):
        if isinstance(holder, Mapping) and isinstance(generation := holder.get(key), int):
            return generation
    return None


def _unsendable(message: str) -> CommandError:
    return CommandError(message, reason="invalid_params")
