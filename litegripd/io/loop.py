"""The one loop of the control thread: a tick first, then a bounded share of requests.

The loop never starts a request that could run into the next tick, and never gives requests more
than their share of a period: a flood at real-time priority would run into the kernel's real-time
throttle, which stops the process for 50 ms in every second. Unserved requests wait in the kernel's
socket buffers. Stops and signals (`Urgent`) are served first in every tick and do not wait behind a
flood of requests.
"""

import ctypes
import logging
import os
import select
import signal
import socket
import time
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Protocol

from litegripd.io.meters import RECENT_S, LatenessMeter, RecentLateness
from litegripd.io.realtime import GarbageCollector

_log = logging.getLogger(__name__)

_CLOCK_MONOTONIC = 1
_TFD_TIMER_ABSTIME = 1
_TFD_CLOEXEC = os.O_CLOEXEC
_NS_PER_S = 1_000_000_000


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


_libc = ctypes.CDLL(None, use_errno=True)


def _timespec(nanoseconds: int) -> _Timespec:
    return _Timespec(nanoseconds // _NS_PER_S, nanoseconds % _NS_PER_S)


def _check(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


class PeriodicTimer:
    """Fires at `first_s + n * period_s` of CLOCK_MONOTONIC, however late it is read.

    By default it first fires one period from now. `wait()` blocks until the next firing and returns
    how many have passed since the last call; the descriptor may also be polled. Raises `OSError` if
    the kernel refuses.
    """

    def __init__(self, period_s: float, first_s: float | None = None) -> None:
        self._period_ns = round(period_s * _NS_PER_S)
        self.period_s = self._period_ns / _NS_PER_S
        self._fd = _check(_libc.timerfd_create(_CLOCK_MONOTONIC, _TFD_CLOEXEC))
        self.restart(time.monotonic() + self.period_s if first_s is None else first_s)

    def restart(self, first_s: float) -> None:
        """Fire at `first_s`, and then every period; a firing that nobody has read is forgotten."""
        self._first_ns = round(first_s * _NS_PER_S)
        self._fired = 0
        self._at_once = 0
        spec = _Itimerspec(_timespec(self._period_ns), _timespec(self._first_ns))
        _check(_libc.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))

    def fileno(self) -> int:
        """Return the descriptor, readable when a firing is due."""
        return self._fd

    def wait(self) -> int:
        """Block until a firing is due; return the number of firings since the last call."""
        count = int.from_bytes(os.read(self._fd, 8), "little")
        self._fired += count
        self._at_once = count
        return count

    @property
    def first_due_s(self) -> float:
        """When the first firing that the last `wait` returned was due."""
        return (self._first_ns + (self._fired - self._at_once) * self._period_ns) / _NS_PER_S

    @property
    def last_due_s(self) -> float:
        """When the latest firing that `wait` returned was due."""
        return (self._first_ns + (self._fired - 1) * self._period_ns) / _NS_PER_S

    @property
    def next_due_s(self) -> float:
        """When the next firing is due."""
        return (self._first_ns + self._fired * self._period_ns) / _NS_PER_S

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self._fd)


REQUEST_SHARE = 0.5  # of each period
SPARE_SHARE = 0.25
"""Of a period: light requests are served for this much longer after a flood has used up its
share."""
GUARD_S = 150e-6  # no request starts closer than this to the next tick
_EVENTS_PER_POLL = 16
ROOM_SHARE = 0.1  # of a period: less than this between two ticks is no room for requests
STARVED_AFTER_S = 0.1
"""After this time without room, one share is served although a tick is due: a loop whose ticks take
longer than its period must still hear a stop and SIGTERM."""
APART_SHARE = 0.2
"""Of a period: no tick begins sooner after the one before, so that the motor's answer to that has
come (about 0.3 ms at 1 Mbit/s)."""


class Handler(Protocol):
    """The handler of a descriptor; `mask` holds the `select.EPOLL*` bits."""

    def on_event(self, mask: int) -> None:
        """Handle what is ready, without waiting."""


class Backlog(Protocol):
    """Requests that were read but not yet answered."""

    @property
    def pending(self) -> bool:
        """True if requests are left."""

    def serve(self, until_s: float, *, light_only: bool = False) -> None:
        """Answer some of them by `until_s`; it is called again while there is time.

        With `light_only` serve only those who have used little: the share of all is used up.
        """

    @property
    def pending_light(self) -> bool:
        """True if requests are left of those who have used little time."""


class Reactor:
    """Calls `on_tick(now_s)` at an absolute rate, serves descriptors and `backlog` in between.

    An exception in a handler is logged and its descriptor removed; one in the tick or in the
    backlog is logged once and counted. None ends the loop.
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
        self._timer: PeriodicTimer | None = None
        self._began_s = float("-inf")
        self._may_hasten = True
        self._is_hastened = False
        self._had_room_s = 0.0
        self._on_tick = on_tick
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}
        self._running = False
        self._collector = GarbageCollector()

    def add(self, fd: int, handler: Handler, mask: int = select.EPOLLIN) -> None:
        """Serve `fd` from now on; raises `OSError` if the kernel refuses."""
        self._epoll.register(fd, mask)
        self._handlers[fd] = handler

    def modify(self, fd: int, mask: int) -> None:
        """Change the events for which `fd` is served."""
        self._epoll.modify(fd, mask)

    def remove(self, fd: int) -> None:
        """Remove `fd`, if it is served; call it before the descriptor is closed."""
        if self._handlers.pop(fd, None) is not None:
            self._epoll.unregister(fd)

    def serves(self, fd: int) -> bool:
        """Return True if `fd` is served; False after its handler has failed."""
        return fd in self._handlers

    def stop(self) -> None:
        """Let `run` return after its present step."""
        self._running = False

    def hasten(self) -> None:
        """Have the next tick come at once, and all later ones by its time.

        For what shall not wait for the rest of a period: a stop. Of two ticks in a row only one is
        hastened, so that a flood of stops does not make a flood of ticks. Called in a tick, it does
        nothing.
        """
        timer = self._timer
        if timer is None or not self._may_hasten:
            return
        first_s = max(time.monotonic(), self._began_s + APART_SHARE * self.period_s)
        if first_s < timer.next_due_s:
            self._may_hasten, self._is_hastened = False, True
            timer.restart(first_s)

    @property
    def longest_collection_s(self) -> float:
        """The longest garbage collection."""
        return self._collector.longest_s

    def freeze(self) -> None:
        """Exempt all living objects from garbage collection, which takes many milliseconds."""
        self._collector.freeze()

    def run(self, first_tick_s: float | None = None) -> None:
        """Run until `stop`; the first tick is one period from now, or at `first_tick_s`."""
        self.freeze()
        self._timer = timer = PeriodicTimer(self.period_s, first_tick_s)
        self.next_tick_s = timer.next_due_s
        self._epoll.register(timer.fileno(), select.EPOLLIN)
        self._running = True
        try:
            while self._running:
                self._run_period(timer)
        finally:
            self._timer = None
            self._epoll.unregister(timer.fileno())
            timer.close()
            self._collector.thaw()

    def close(self) -> None:
        """Close the epoll descriptor."""
        self._epoll.close()

    def _run_period(self, timer: PeriodicTimer) -> None:
        """Serve requests until a tick is due, then do the tick."""
        latest_s = self._latest_s(timer.next_due_s - GUARD_S)
        if self._serve_until(latest_s, timer.fileno(), is_late=latest_s > timer.next_due_s):
            self.budget_exhausted += 1
        fired = timer.wait()
        self._began_s = now_s = time.monotonic()
        was_hastened, self._is_hastened, self._may_hasten = self._is_hastened, False, False
        self.next_tick_s = timer.next_due_s
        self.late_s = late_s = now_s - timer.first_due_s  # the first of the lost ticks
        self.lateness.add(late_s)
        self.recent_lateness.add(now_s, late_s)
        self.ticks += fired
        self.lost_ticks += fired - 1
        try:
            self._on_tick(now_s)
        except Exception:  # noqa: BLE001 - the loop survives any defect above it
            self.tick_errors += 1
            if self.tick_errors == 1:
                _log.exception("the tick failed; further failures are only counted")
        self._may_hasten = not was_hastened
        ended_s = time.monotonic()
        self.tick_cost.add(ended_s - now_s)
        if ended_s < timer.next_due_s - self.period_s / 2:
            self._collector.collect(ended_s)

    def _latest_s(self, latest_s: float) -> float:
        """Return until when requests are served; later than `latest_s` only if they starve."""
        now_s = time.monotonic()
        if now_s + self.period_s * ROOM_SHARE < latest_s:
            self._had_room_s = now_s
        elif now_s - self._had_room_s >= STARVED_AFTER_S:
            self._had_room_s = now_s
            self.late_shares += 1
            return now_s + self.period_s * REQUEST_SHARE
        return latest_s

    def _serve_until(self, latest_s: float, timer_fd: int, *, is_late: bool) -> bool:
        """Serve until the timer fires or the share is used up; return True if it was used up.

        Those who have used little time are served beyond that, while there is spare time. With
        `is_late`, waiting requests are served until `latest_s` although the timer has fired.
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
                if self._is_hastened:
                    return False
            self._serve_backlog(until_s, is_spare)
            ended_s = time.monotonic()
            if is_spare:
                spare_s -= ended_s - started_s
            else:
                left_s = max(left_s - (ended_s - started_s), 0.0)
            is_over = is_due and not (is_late and self._is_pending(is_spare))
            if is_over or self._is_hastened or ended_s >= latest_s:
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
            self.backlog.serve(until_s, light_only=is_spare)
        except Exception:  # noqa: BLE001 - the loop survives any defect above it
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


SHARE = 0.1
"""Of a period; a flood of stops can take at most this much of each tick."""


class Urgent:
    """A set of descriptors; register `fileno()` with the loop, and call `serve` first.

    The descriptors take turns: one that is always ready keeps no other waiting. A handler that
    fails is called again: no defect makes the daemon deaf to a stop.
    """

    def __init__(self, period_s: float) -> None:
        self.errors = 0
        self._share_s = SHARE * period_s
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}

    def fileno(self) -> int:
        """Return the descriptor that is readable when any of the registered ones is."""
        return self._epoll.fileno()

    def add(self, fd: int, handler: Handler) -> None:
        """Serve `fd` whenever it can be read; raises `OSError` if the kernel refuses."""
        self._epoll.register(fd, select.EPOLLIN)
        self._handlers[fd] = handler

    def remove(self, fd: int) -> None:
        """Remove `fd`, if it is served; call it before the descriptor is closed."""
        if self._handlers.pop(fd, None) is not None:
            self._epoll.unregister(fd)

    def serve(self) -> None:
        """Serve what is ready now, without waiting, within its share of a period."""
        until_s = time.monotonic() + self._share_s
        while ready := self._epoll.poll(0, 1):  # one at a time: the kernel lets them take turns
            self._dispatch(*ready[0])
            if time.monotonic() >= until_s:
                return

    def on_event(self, _mask: int) -> None:
        """Serve between two ticks."""
        self.serve()

    def close(self) -> None:
        """Close the epoll descriptor."""
        self._epoll.close()

    def _dispatch(self, fd: int, mask: int) -> None:
        try:
            self._handlers[fd].on_event(mask)
        except Exception:  # noqa: BLE001 - one descriptor must not end the others
            self.errors += 1
            if self.errors == 1:
                _log.exception("the handler of descriptor %d failed; it is still served", fd)


class Signals:
    """Turns signals into calls from the loop; register `fileno()` with the reactor."""

    def __init__(self, handlers: Mapping[signal.Signals, Callable[[], None]]) -> None:
        self._handlers = dict(handlers)
        self._reader, self._writer = socket.socketpair()
        self._reader.setblocking(False)
        self._writer.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for number in self._handlers:
            signal.signal(number, _noted)

    def fileno(self) -> int:
        """Return the descriptor that is readable when a signal has come."""
        return self._reader.fileno()

    def on_event(self, _mask: int) -> None:
        """Call the handlers of the signals that have come."""
        for number in self._reader.recv(64):
            handler = self._handlers.get(signal.Signals(number))
            if handler is not None:
                handler()

    def close(self) -> None:
        """Ignore the signals: one more must not turn an orderly end into a death by a signal."""
        for number in self._handlers:  # a handler of Python's would be gone before the process is
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)
        self._reader.close()
        self._writer.close()


def _noted(_number: int, _frame: FrameType | None) -> None:
    """Do nothing: the wake-up descriptor has notified the loop already."""


class ProcessWatch:
    """Calls `on_end` once, from the event loop, when process `pid` has ended.

    Raises `OSError` if the process cannot be watched: it has ended already, or is in another pid
    namespace, whose processes have no number here (pid 0).
    """

    def __init__(self, reactor: Reactor, pid: int, on_end: Callable[[], None]) -> None:
        self._reactor = reactor
        self._on_end = on_end
        self._pidfd: int | None = os.pidfd_open(pid)
        try:
            reactor.add(self._pidfd, self)
        except OSError:
            os.close(self._pidfd)
            raise

    def on_event(self, _mask: int) -> None:
        """Record the end."""
        self.close()
        self._on_end()

    def close(self) -> None:
        """Stop watching."""
        if self._pidfd is not None:
            self._reactor.remove(self._pidfd)
            os.close(self._pidfd)
            self._pidfd = None
