"""A gripper that the page shows, and how its daemon is reached."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from litegrip_client.core.discovery import reach


@dataclass(frozen=True, slots=True)
class Gripper:
    """Its channel, and the daemon's socket where that was given."""

    channel: str
    socket: str | None = None

    async def connect(
        self, longest_line_bytes: int
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Connect to the daemon; raises `ConnectError` where none answers."""

        async def attempt(path: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            return await asyncio.open_unix_connection(path, limit=longest_line_bytes)

        return await reach(self.channel, self.socket, attempt)
