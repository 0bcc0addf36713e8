"""The one loop of the control thread: a tick first, then a bounded share of requests.

The loop never lets a request start that could run into the next tick, and never lets requests
use more than their share of a period: a flood at real-time priority would otherwise run into
the kernel's real-time throttle, which stops the process for 50 ms in every second. What is not
served waits in the kernel's socket buffers.
"""

import logging
import select
import time
from collections.abc import Callable
from typing import Protocol

from litegripd.io.meters import LatenessMeter
from litegripd.io.realtime import GarbageCollector
from litegripd.io.timerfd import PeriodicTimer

_log = logging.getLogger(__name__)

REQUEST_SHARE = 0.5  # of each period
GUARD_S = 150e-6  # no request starts closer than this to the next tick
_EVENTS_PER_POLL = 16


class Handler(Protocol):
    """What a descriptor is registered with; `mask` holds the `select.EPOLL*` bits."""

    def on_event(self, mask: int) -> None:
        """Do what is ready, without waiting."""


class Backlog(Protocol):
    """Requests that were read but not yet answered."""

    @property
    def pending(self) -> bool:
        """Whether anything is left."""

    def serve(self, until_s: float) -> None:
        """Answer what can be answered by `until_s`."""


class Reactor:
    """Calls `on_tick(now_s)` at an absolute rate, serves descriptors and `backlog` in between.

    An exception in a handler is logged and its descriptor forgotten; one in the tick is logged
    and counted: neither ends the loop.
    """

    def __init__(self, period_s: float, on_tick: Callable[[float], None]) -> None:
        self.period_s = period_s
        self.backlog: Backlog | None = None
        self.lateness = LatenessMeter()
        self.tick_cost = LatenessMeter()
        self.ticks = 0
        self.lost_ticks = 0
        self.tick_errors = 0
        self.budget_exhausted = 0
        self._on_tick = on_tick
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}
        self._running = False
        self._collector = GarbageCollector()

    def add(self, fd: int, handler: Handler, mask: int = select.EPOLLIN) -> None:
        """Serve `fd` from now on."""
        self._handlers[fd] = handler
        self._epoll.register(fd, mask)

    def modify(self, fd: int, mask: int) -> None:
        """Change what `fd` is served for."""
        self._epoll.modify(fd, mask)

    def remove(self, fd: int) -> None:
        """Forget `fd`; call it before the descriptor is closed."""
        if self._handlers.pop(fd, None) is not None:
            self._epoll.unregister(fd)

    def stop(self) -> None:
        """Let `run` return after what it is doing now."""
        self._running = False

    @property
    def longest_collection_s(self) -> float:
        """How long the longest garbage collection took."""
        return self._collector.longest_s

    def run(self) -> None:
        """Run until `stop`."""
        self._collector.freeze()
        timer = PeriodicTimer(self.period_s)
        self._epoll.register(timer.fileno(), select.EPOLLIN)
        self._running = True
        try:
            while self._running:
                self._run_period(timer)
        finally:
            self._epoll.unregister(timer.fileno())
            timer.close()

    def close(self) -> None:
        """Give the epoll descriptor back."""
        self._epoll.close()

    def _run_period(self, timer: PeriodicTimer) -> None:
        """Wait for a tick while serving requests, then do the tick."""
        latest_s = timer.next_due_s - GUARD_S
        if self._serve_until(latest_s, timer.fileno()):
            self.budget_exhausted += 1
        fired = timer.wait()
        now_s = time.monotonic()
        self.lateness.add(now_s - timer.last_due_s)
        self.ticks += fired
        self.lost_ticks += fired - 1
        try:
            self._on_tick(now_s)
        except Exception:  # noqa: BLE001 - the loop outlives any defect above it
            self.tick_errors += 1
            if self.tick_errors == 1:
                _log.exception("the tick failed; further failures are only counted")
        ended_s = time.monotonic()
        self.tick_cost.add(ended_s - now_s)
        if ended_s < timer.next_due_s - self.period_s / 2:
            self._collector.collect(ended_s)

    def _serve_until(self, latest_s: float, timer_fd: int) -> bool:
        """Serve until the timer fires or the share is used up; tell whether it was used up."""
        left_s = self.period_s * REQUEST_SHARE
        while self._running:
            pending = self.backlog is not None and self.backlog.pending
            events = self._epoll.poll(0 if pending else -1, _EVENTS_PER_POLL)
            started_s = time.monotonic()
            until_s = min(started_s + left_s, latest_s)
            for fd, mask in events:
                if fd == timer_fd:
                    return False
                if time.monotonic() >= until_s:
                    break
                self._dispatch(fd, mask)
            if self.backlog is not None:
                self.backlog.serve(until_s)
            ended_s = time.monotonic()
            left_s -= ended_s - started_s
            if left_s <= 0.0:
                return True
            if ended_s >= latest_s:
                return False
        return False

    def _dispatch(self, fd: int, mask: int) -> None:
        handler = self._handlers.get(fd)
        if handler is None:
            return  # removed by an earlier handler of the same poll
        try:
            handler.on_event(mask)
        except Exception:  # noqa: BLE001 - one descriptor must not end the others
            _log.exception("the handler of descriptor %d failed; it is no longer served", fd)
            self.remove(fd)
