"""The last minute of a gripper, for the plots of a page that is opened now."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any

from litegrip_client.line.exchange import request_line
from litegrip_client.values.errors import ConnectError
from litegrip_web.gripper import Gripper

SECONDS = 60.0
HZ = 10.0
FIELDS = ("monotonic_s", "opening_mm", "command_rad", "force_n", "force_set_n", "stale")
_BATCH = 5
RECONNECT_EVERY_S = 1.0
_LONGEST_LINE_BYTES = 1024 * 1024


class History:
    """Keeps the rows of `FIELDS` of the last minute while the daemon runs; begins anew with it."""

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper
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
        reader, writer = await self._gripper.connect(_LONGEST_LINE_BYTES)
        try:
            writer.write(request_line(1, "hello", {"client": "litegripd-web"}))
            wanted = {"hz": HZ, "fields": FIELDS, "batch": _BATCH}
            writer.write(request_line(2, "state.subscribe", wanted))
            while line := await reader.readline():
                message = json.loads(line)
                if message.get("method") == "state.batch":
                    self._rows.extend(message["params"]["rows"])
        finally:
            writer.close()
        raise ConnectionResetError("the daemon has closed the connection")
