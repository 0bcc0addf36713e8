"""The last minute of a gripper, for the plots of a page that is opened now."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any

from litegrip_client.core.discovery import reach
from litegrip_client.values.errors import ConnectError

SECONDS = 60.0
HZ = 10.0
FIELDS = (
    "monotonic_s",
    "opening_mm",
    "command_rad",
    "force_n",
    "force_set_n",
    "stale",
)
_BATCH = 5
RECONNECT_EVERY_S = 1.0
_LONGEST_LINE_BYTES = 1024 * 1024


class History:
    """Keeps the rows of `FIELDS` of the last minute while the daemon runs; begins anew with it."""

    def __init__(self, channel: str, socket: str | None) -> None:
        self._channel = channel
        self._socket = socket
        self._rows: deque[list[Any]] = deque(maxlen=int(SECONDS * HZ))

    def as_params(self) -> dict[str, Any]:
        """Return the rows, the oldest first; each has the values of `fields`."""
        return {"fields": list(FIELDS), "rows": list(self._rows)}

    async def keep(self) -> None:
        """Follow the daemon until the task is cancelled."""
        while True:
            try:
                await self._follow()
            except (ConnectError, OSError, ValueError):
                self._rows.clear()  # another daemon counts its time from another start
            await asyncio.sleep(RECONNECT_EVERY_S)

    async def _follow(self) -> None:
        """Take samples as long as the daemon gives them; raises `OSError` or `ValueError` then."""

        async def attempt(path: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            return await asyncio.open_unix_connection(path, limit=_LONGEST_LINE_BYTES)

        reader, writer = await reach(self._channel, self._socket, attempt)
        try:
            for number, (method, params) in enumerate(
                (
                    ("hello", {"client": "litegripd-web, plots"}),
                    ("state.subscribe", {"hz": HZ, "fields": FIELDS, "batch": _BATCH}),
                )
            ):
                request = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
                writer.write(json.dumps(request).encode() + b"\n")
            while line := await reader.readline():
                message = json.loads(line)
                if message.get("method") == "state.batch":
                    self._rows.extend(message["params"]["rows"])
        finally:
            writer.close()
        raise ConnectionResetError("the daemon has closed the connection")
