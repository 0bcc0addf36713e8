"""What waits to be sent to one browser: everything in its order, but of the states the newest.

A slow link would otherwise show jaws as they were half a minute ago as if that were now: behind
the browser are buffers of the kernel and of tunnels, whose sizes nobody knows. So a browser says
which states it has shown, and few are on their way at a time: fewer still where they take long,
because each waits behind those before it.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable

STATES_ON_THEIR_WAY = 4
"""At 20 states a second, a link may take 0.2 s there and back before there are fewer."""

SLOW_S, QUICK_S = 0.4, 0.2
"""A state that took longer than the first lets one less be on its way; quicker ones, one more."""

MOST_BYTES = 1024 * 1024
"""Of what is no state; then the daemon is not read, which knows what to do about that."""


class Outbox:
    """Messages for a browser; `put` and `take` are called by one task each."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._queue: deque[str] = deque()
        self._bytes = 0
        self._state: str | None = None
        self._unseen_since_s: deque[float] = deque()
        self._most_unseen = STATES_ON_THEIR_WAY
        self._changed = asyncio.Event()

    async def put(self, message: str) -> None:
        """Add a message behind all others; wait while there is no room."""
        while self._bytes > MOST_BYTES:
            await self._change()
        self.put_now(message)

    def put_now(self, message: str) -> None:
        """Add a short message behind all others, whether there is room or not."""
        self._queue.append(message)
        self._bytes += len(message)
        self._changed.set()

    def put_state(self, state: str) -> None:
        """Let a state take the place of the one that waits."""
        self._state = state
        self._changed.set()

    def see(self) -> None:
        """Note that the browser has shown a state."""
        if self._unseen_since_s:
            took_s = self._clock() - self._unseen_since_s.popleft()
            if took_s > SLOW_S:
                self._most_unseen = max(1, self._most_unseen - 1)
            elif took_s < QUICK_S:
                self._most_unseen = min(STATES_ON_THEIR_WAY, self._most_unseen + 1)
        self._changed.set()

    def forget_states(self) -> None:
        """Forget what was on its way: the daemon has gone, and what it said last holds no more."""
        self._state = None
        self._unseen_since_s.clear()

    async def take(self) -> str:
        """Return what is to be sent next, as soon as there is something."""
        while True:
            if self._queue:
                message = self._queue.popleft()
                self._bytes -= len(message)
                self._changed.set()
                return message
            if self._state is not None and len(self._unseen_since_s) < self._most_unseen:
                state, self._state = self._state, None
                self._unseen_since_s.append(self._clock())
                return state
            await self._change()

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()
