"""The stops of one gripper, by its daemon's own socket for stops, beside everything else.

However many browsers ask, one stop is on its way and one waits behind it: a stop that is asked for
while another is on its way may come after a clearing, so it is sent, too, but all that wait
meanwhile are answered by the same. No gripper waits for another one's daemon.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from litegrip_client.core.discovery import reach
from litegrip_client.core.sockets import STOP_LEVELS
from litegrip_client.core.stop import STOP_WITHIN_S, stop_at
from litegrip_web.gripper import Gripper


class Stops:
    """Stops a gripper."""

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper
        # Its own, and enough for all that is on its way: no stop waits for a thread.
        self._threads = ThreadPoolExecutor(len(STOP_LEVELS), "stop")
        self._under_way: dict[str, asyncio.Task[dict[str, Any]]] = {}
        self._next: dict[str, asyncio.Task[dict[str, Any]]] = {}

    async def stop(self, level: str, why: str | None) -> dict[str, Any]:
        """Stop; return the daemon's answer. A stop is given though its asker goes.

        Raises `LiteGripError` if no daemon confirms it in time.
        """
        if level not in self._under_way:
            task = asyncio.create_task(self._give(level, why))
            self._begin(level, task)
        elif level not in self._next:
            before = self._under_way[level]
            task = self._next[level] = asyncio.create_task(self._after(before, level, why))
        else:
            task = self._next[level]
        return await asyncio.shield(task)

    def _begin(self, level: str, task: asyncio.Task[dict[str, Any]]) -> None:
        self._under_way[level] = task
        task.add_done_callback(lambda ended: self._end(level, ended))

    def _end(self, level: str, ended: asyncio.Task[dict[str, Any]]) -> None:
        if not ended.cancelled():
            ended.exception()  # whoever still waits for it is told; that nobody does is no error
        del self._under_way[level]
        if (task := self._next.pop(level, None)) is not None:
            self._begin(level, task)

    async def _after(
        self, before: asyncio.Task[dict[str, Any]], level: str, why: str | None
    ) -> dict[str, Any]:
        """Give a stop once the one that is under way has ended."""
        await asyncio.wait({before})
        return await self._give(level, why)

    async def _give(self, level: str, why: str | None) -> dict[str, Any]:
        def attempt(path: str) -> asyncio.Future[dict[str, Any]]:
            loop = asyncio.get_running_loop()
            return loop.run_in_executor(self._threads, stop_at, path, level, why, STOP_WITHIN_S)

        return await reach(self._gripper.channel, self._gripper.socket, attempt)
