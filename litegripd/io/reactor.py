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

from litegripd.io.meters import LatenessMeter, RecentLateness
from litegripd.io.realtime import GarbageCollector
from litegripd.io.timerfd import PeriodicTimer

_log = logging.getLogger(__name__)

REQUEST_SHARE = 0.5  # of each period
SPARE_SHARE = 0.25
"""Of each period: so much longer light requests are served once a flood has used up its share."""
GUARD_S = 150e-6  # no request starts closer than this to the next tick
_EVENTS_PER_POLL = 16
RECENT_S = 30.0
ROOM_SHARE = 0.1  # of a period: less than this between two ticks is no room for requests
STARVED_AFTER_S = 0.1
"""After so long without room, one share is served although a tick is due: a loop whose ticks take
longer than its period must still hear a stop and SIGTERM."""


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
        """Answer some of it by `until_s`; it is called again while there is time."""

    @property
    def pending_light(self) -> bool:
        """Whether anything is left of who has used little time."""

    def serve_light(self, until_s: float) -> None:
        """Answer some of that by `until_s`, though the share of all requests is used up."""


class Reactor:
    """Calls `on_tick(now_s)` at an absolute rate, serves descriptors and `backlog` in between.

    An exception in a handler is logged and its descriptor forgotten; one in the tick or in the
    backlog is logged once and counted: none ends the loop.
    """

    def __init__(self, period_s: float, on_tick: Callable[[float], None]) -> None:
        self.period_s = period_s
        self.backlog: Backlog | None = None
        self.lateness = LatenessMeter()
        self.recent_lateness = RecentLateness(RECENT_S)
        self.tick_cost = LatenessMeter()
        self.late_s = 0.0
        self.ticks = 0
        self.lost_ticks = 0
        self.tick_errors = 0
        self.backlog_errors = 0
        self.budget_exhausted = 0
        self.late_shares = 0
        self.next_tick_s = 0.0
        self._had_room_s = 0.0
        self._on_tick = on_tick
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}
        self._running = False
        self._collector = GarbageCollector()

    def add(self, fd: int, handler: Handler, mask: int = select.EPOLLIN) -> None:
        """Serve `fd` from now on; raises `OSError` where the kernel refuses."""
        self._epoll.register(fd, mask)
        self._handlers[fd] = handler

    def modify(self, fd: int, mask: int) -> None:
        """Change what `fd` is served for."""
        self._epoll.modify(fd, mask)

    def remove(self, fd: int) -> None:
        """Forget `fd`, if it is served; call it before the descriptor is closed."""
        if self._handlers.pop(fd, None) is not None:
            self._epoll.unregister(fd)

    def serves(self, fd: int) -> bool:
        """Whether `fd` is served; one whose handler has failed is not."""
        return fd in self._handlers

    def stop(self) -> None:
        """Let `run` return after what it is doing now."""
        self._running = False

    @property
    def longest_collection_s(self) -> float:
        """How long the longest garbage collection took."""
        return self._collector.longest_s

    def freeze(self) -> None:
        """Exempt all that lives now from garbage collection, which takes many milliseconds."""
        self._collector.freeze()

    def run(self, first_tick_s: float | None = None) -> None:
        """Run until `stop`; the first tick is one period from now, or at `first_tick_s`."""
        self.freeze()
        timer = PeriodicTimer(self.period_s, first_tick_s)
        self.next_tick_s = timer.next_due_s
        self._epoll.register(timer.fileno(), select.EPOLLIN)
        self._running = True
        try:
            while self._running:
                self._run_period(timer)
        finally:
            self._epoll.unregister(timer.fileno())
            timer.close()
            self._collector.thaw()

    def close(self) -> None:
        """Give the epoll descriptor back."""
        self._epoll.close()

    def _run_period(self, timer: PeriodicTimer) -> None:
        """Wait for a tick while serving requests, then do the tick."""
        latest_s = self._latest_s(timer.next_due_s - GUARD_S)
        if self._serve_until(latest_s, timer.fileno(), is_late=latest_s > timer.next_due_s):
            self.budget_exhausted += 1
        fired = timer.wait()
        now_s = time.monotonic()
        self.next_tick_s = timer.next_due_s
        self.late_s = late_s = now_s - timer.first_due_s  # of lost ticks, the first
        self.lateness.add(late_s)
        self.recent_lateness.add(now_s, late_s)
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

    def _latest_s(self, latest_s: float) -> float:
        """Return until when requests are served; later than `latest_s` only when they starve."""
        now_s = time.monotonic()
        if now_s + self.period_s * ROOM_SHARE < latest_s:
            self._had_room_s = now_s
        elif now_s - self._had_room_s >= STARVED_AFTER_S:
            self._had_room_s = now_s
            self.late_shares += 1
            return now_s + self.period_s * REQUEST_SHARE
        return latest_s

    def _serve_until(self, latest_s: float, timer_fd: int, *, is_late: bool) -> bool:
        """Serve until the timer fires or the share is used up; tell whether it was used up.

        Those who have used little time are served beyond that, as long as there is spare time.
        With `is_late` what waits is served until `latest_s` although the timer has fired.
        """
        left_s = self.period_s * REQUEST_SHARE
        spare_s = self.period_s * SPARE_SHARE
        while self._running and left_s + spare_s > 0.0:
            is_spare = left_s <= 0.0
            events = self._epoll.poll(0 if self._is_pending(is_spare) else -1, _EVENTS_PER_POLL)
            started_s = time.monotonic()
            until_s = min(started_s + (spare_s if is_spare else left_s), latest_s)
            is_due = False
            for fd, mask in events:
                if fd == timer_fd:
                    is_due = True
                    continue
                if time.monotonic() >= until_s:
                    break
                self._dispatch(fd, mask)
            self._serve_backlog(until_s, is_spare)
            ended_s = time.monotonic()
            if is_spare:
                spare_s -= ended_s - started_s
            else:
                left_s = max(left_s - (ended_s - started_s), 0.0)
            is_over = is_due and not (is_late and self._is_pending(is_spare))
            if is_over or ended_s >= latest_s:
                break
        return left_s <= 0.0

    def _is_pending(self, is_spare: bool) -> bool:
        if self.backlog is None:
            return False
        return self.backlog.pending_light if is_spare else self.backlog.pending

    def _serve_backlog(self, until_s: float, is_spare: bool) -> None:
        if self.backlog is None:
            return
        try:
            if is_spare:
                self.backlog.serve_light(until_s)
            else:
                self.backlog.serve(until_s)
        except Exception:  # noqa: BLE001 - the loop outlives any defect above it
            self.backlog_errors += 1
            if self.backlog_errors == 1:
                _log.exception("serving a request failed; further failures are only counted")

    def _dispatch(self, fd: int, mask: int) -> None:
        handler = self._handlers.get(fd)
        if handler is None:
            return  # removed by an earlier handler of the same poll
        try:
            handler.on_event(mask)
        except Exception:  # noqa: BLE001 - one descriptor must not end the others
            _log.exception("the handler of descriptor %d failed; it is no longer served", fd)
            self.remove(fd)
