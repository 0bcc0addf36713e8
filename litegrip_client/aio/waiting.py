"""Tasks that wait until something is so. What that is, this module does not know."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable


class Waiting:
    """The tasks that wait for one connection; every change wakes them."""

    def __init__(self) -> None:
        self._waiting: dict[asyncio.Future[None], Callable[[], bool]] = {}

    async def until(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for `ready` for at most `timeout_s` seconds; return True if it is so."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        while not ready():
            remaining_s = deadline_s - loop.time()
            if remaining_s <= 0.0:
                return False
            # `asyncio.wait_for` may lose a cancelling that comes together with what it waits for.
            waiter: asyncio.Future[None] = loop.create_future()
            timer = None
            if not math.isinf(remaining_s):
                timer = loop.call_later(remaining_s, _wake, waiter)
            self._waiting[waiter] = ready
            try:
                await waiter
            finally:
                del self._waiting[waiter]
                if timer is not None:
                    timer.cancel()
        return True

    def wake(self) -> None:
        """Let those go on for whom it is so by now."""
        for waiter, ready in self._waiting.items():
            if ready():
                _wake(waiter)


def _wake(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
