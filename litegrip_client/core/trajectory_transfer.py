"""Send and fetch trajectories in pieces, each within the length of a line.

Contents pass through here unread; what they may be is the daemon's to say.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Mapping

from litegrip_client.core.link import ACTION_TIMEOUT_S
from litegrip_client.errors import CommandError, ProtocolError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.wire import Wire

PIECE_BYTES = 8192

_Share = Callable[[float], None]


async def fetch(
    wire: Wire, source: Mapping[str, Any], on_share: _Share = lambda _share: None
) -> bytes:
    """Return the whole content of what `source` says to `trajectory.get`.

    `on_share` is called with the share that is there. Raises `CommandError` when it is another one
    in the middle, because somebody has replaced it.
    """
    whole = bytearray()
    told: tuple[int, str] | None = None
    while told is None or len(whole) < told[0]:
        params = {**source, "offset": len(whole)}
        piece = await wire.call("trajectory.get", params, ACTION_TIMEOUT_S)
        first, told = told, (int(piece["total"]), str(piece["sha256"]))
        if first not in (None, told):
            text = "the trajectory was replaced while it was being fetched: fetch it again"
            raise CommandError(text, reason="trajectory_unreadable", data={"retryable": True})
        data = base64.b64decode(piece["data"])
        if not data and len(whole) < told[0]:
            raise ProtocolError(f"the daemon sent nothing of a trajectory from {len(whole)} on")
        whole += data
        on_share(len(whole) / max(told[0], 1))
    content = bytes(whole)
    if hashlib.sha256(content).hexdigest() != told[1]:
        raise ProtocolError("what the daemon sent of a trajectory has not the SHA-256 that it told")
    return content


async def fetch_grips(wire: Wire, source: Mapping[str, Any]) -> bytes:
    """Return the file of grips of what `source` says, nothing where there is none."""
    return await fetch(wire, {**source, "format": "grip"})


async def send(
    wire: Wire,
    content: bytes,
    more: Mapping[str, Any] | None = None,
    on_share: _Share = lambda _share: None,
    grips: bytes = b"",
) -> dict[str, Any]:
    """Send a whole content, and the file of its grips; return the answer to the last piece.

    `more` are further parameters of `trajectory.put`: under which name to keep it, say.
    """
    content += grips
    common = {"total": len(content), "sha256": hashlib.sha256(content).hexdigest(), **(more or {})}
    if grips:
        common["grip_bytes"] = len(grips)
    answer: dict[str, Any] = {}
    for offset in range(0, max(len(content), 1), PIECE_BYTES):
        data = base64.b64encode(content[offset : offset + PIECE_BYTES]).decode()
        params = {"offset": offset, "data": data, **common}
        answer = await wire.call("trajectory.put", params, ACTION_TIMEOUT_S)
        on_share(min(1.0, (offset + PIECE_BYTES) / max(len(content), 1)))
    return answer
