"""Threads in virtual time: one runs at a time, so a program does the same each time it is run.

A thread has its turn until it waits: for a while, an event, a lock, a condition, another thread's
end, or for what a daemon sends. Then the next one that has what it waited for goes on; the order is
that in which the threads were started, and goes round. Only when nobody can go on does time pass,
by one period. So what threads share needs no lock here, and no two of them ever race.

`Turns.threading` stands in for the module `threading`, and `Turns.modules` is all that a program
has to be given. The thread that made the `Turns` is the program's main one: whatever goes wrong, in
a thread or while time passes, is raised there, and so is a `Deadlock`. A thread that never waits
keeps the turn: nothing here can take it away.
"""

import importlib.util
import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

_LEAST_S = 1e-6
"""What is due within this is due: the sum of many periods is not exact. No wait is shorter."""


class Deadlock(Exception):  # noqa: N818 - that is what it is called
    """Every thread waits for another one, for ever; or they go round and come to no end."""


class _Over(BaseException):
    """Unwinds a thread whose program has ended."""


class _Place:
    """A thread's place in the round, and what it waits for there."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.goes_on = threading.Semaphore(0)
        self.until: Callable[[], bool] = _never
        self.began_s, self.ends_s = 0.0, math.inf


def _never() -> bool:
    return False


class Turns:
    """Gives the turn from thread to thread, and lets time pass by `tick`.

    As a context it is a program's life: at its end the main thread waits for all threads but the
    daemonic ones, which end where they wait. `most_s` is how long it may wait without a limit.
    """

    def __init__(
        self, tick: Callable[[], None], now: Callable[[], float], most_s: float = 600.0
    ) -> None:
        self._tick, self._now, self._most_s = tick, now, most_s
        self._error: BaseException | None = None
        self._main = _Place("main")
        self._round = [self._main]
        self._here = {threading.get_ident(): self._main}
        self._threads: list[_Thread] = []
        self._is_over = False
        self.threading = SimpleNamespace(
            Thread=type("Thread", (_Thread,), {"turns": self}),
            Lock=lambda: _Lock(self, is_reentrant=False),
            RLock=lambda: _Lock(self, is_reentrant=True),
            Condition=lambda lock=None: _Condition(self, lock),
            Event=lambda: _Event(self),
            get_ident=threading.get_ident,
        )

    def modules(self) -> dict[str, Any]:
        """Return what stands in for the modules of these names, for a program that imports them."""
        spec = importlib.util.find_spec("queue")
        assert spec is not None
        assert spec.loader is not None
        queue: Any = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(queue)
        queue.threading, queue.time = self.threading, self._now
        clock = SimpleNamespace(time=self._now, monotonic=self._now, sleep=self.sleep)
        return {"time": clock, "threading": self.threading, "queue": queue}

    def wait(self, until: Callable[[], bool], timeout_s: float = math.inf) -> bool:
        """Wait until something holds, at most for a while; tell whether it holds."""
        place = self._here[threading.get_ident()]
        self._check(place)
        if until():
            return True
        place.until, place.began_s = until, self._now()
        place.ends_s = place.began_s + (max(timeout_s, 2.0 * _LEAST_S) if timeout_s > 0.0 else 0.0)
        following = self._next(self._round.index(place) + 1)
        if following is not place:
            following.goes_on.release()
            place.goes_on.acquire()
        self._check(place)
        return until()

    def sleep(self, duration_s: float) -> None:
        """Wait for a while, at least; the others have their turns also when it is 0."""
        self.wait(_never, duration_s)

    def _check(self, place: _Place) -> None:
        """Raise what a thread has to be told."""
        if place is not self._main:
            if self._is_over:
                raise _Over
        elif self._error is not None:
            error, self._error = self._error, None
            raise error

    def _next(self, at: int) -> _Place:
        """Return the first that can go on, from a place of the round on; time passes until then."""
        while True:
            for place in self._round[at:] + self._round[:at]:
                if self._now() > place.ends_s - _LEAST_S or place.until():
                    return place
            if self._error is not None:
                return self._main
            if all(math.isinf(place.ends_s) for place in self._round):
                self._fail(Deadlock(f"all wait for ever: {self._names}"))
            elif math.isinf(self._main.ends_s) and self._now() > self._main.began_s + self._most_s:
                self._fail(Deadlock(f"{self._names} go on for {self._most_s:.0f} s and more"))
            else:
                try:
                    self._tick()
                except BaseException as error:  # noqa: BLE001 - the main thread raises it
                    self._fail(error)

    @property
    def _names(self) -> str:
        return ", ".join(place.name for place in self._round)

    def _fail(self, error: BaseException) -> None:
        """Have the main thread raise an error; the first counts."""
        self._error = self._error or error

    def _run(self, thread: "_Thread", function: Callable[[], None]) -> None:
        """Be a thread, from its first turn to its last."""
        place = thread.place
        self._here[threading.get_ident()] = place
        place.goes_on.acquire()
        try:
            self._check(place)
            function()
        except (_Over, SystemExit):
            place.until = _never
        except BaseException as error:  # noqa: BLE001 - the main thread raises it
            self._fail(error)
        del self._here[threading.get_ident()]
        at = self._round.index(place)
        del self._round[at]
        thread.is_over = True
        self._next(at).goes_on.release()

    def __enter__(self) -> "Turns":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                for thread in self._threads:
                    if not thread.daemon:
                        thread.join()
                self._check(self._main)
        finally:
            self._end_all()

    def _end_all(self) -> None:
        self._is_over = True
        for thread in self._threads:
            self._main.ends_s = self._now()
            if not thread.is_over:
                thread.place.goes_on.release()
                self._main.goes_on.acquire()
            threading.Thread.join(thread)
        self._threads.clear()
        self._error, self._is_over = None, False


class _Thread(threading.Thread):
    """A thread that runs in its turns; it is in the round once it was started."""

    turns: Turns
    is_over = False
    place: _Place

    def start(self) -> None:
        self.place = _Place(self.name)
        self.place.ends_s = self.turns._now()
        self.turns._round.append(self.place)
        self.turns._threads.append(self)
        super().start()

    def run(self) -> None:
        self.turns._run(self, super().run)

    def is_alive(self) -> bool:
        return super().is_alive() and not self.is_over

    def join(self, timeout: float | None = None) -> None:
        self.turns.wait(lambda: self.is_over, math.inf if timeout is None else timeout)


class _Lock:
    def __init__(self, turns: Turns, *, is_reentrant: bool) -> None:
        self._turns, self._is_reentrant = turns, is_reentrant
        self._owner, self._depth = 0, 0

    def acquire(self, blocking: bool = True, timeout: float = -1.0) -> bool:
        mine = self._is_reentrant and self._owner == threading.get_ident()
        if not mine and self._depth:
            limit_s = math.inf if timeout < 0.0 else timeout
            if not blocking or not self._turns.wait(lambda: self._depth == 0, limit_s):
                return False
        self._owner, self._depth = threading.get_ident(), self._depth + 1
        return True

    def release(self) -> None:
        if not self._depth:
            raise RuntimeError("a lock that nobody has cannot be released")
        self._depth -= 1

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()

    def let_go(self) -> int:
        """Release it for another thread altogether; return what `take_back` wants."""
        depth, self._depth = self._depth, 0
        return depth

    def take_back(self, depth: int) -> None:
        self._turns.wait(lambda: self._depth == 0)
        self._owner, self._depth = threading.get_ident(), depth


class _Condition:
    def __init__(self, turns: Turns, lock: _Lock | None) -> None:
        self._turns = turns
        self._lock = lock or _Lock(turns, is_reentrant=True)
        self._waiting: list[object] = []

    def wait(self, timeout: float | None = None) -> bool:
        token, depth = object(), self._lock.let_go()
        self._waiting.append(token)
        limit_s = math.inf if timeout is None else timeout
        try:
            return self._turns.wait(lambda: token not in self._waiting, limit_s)
        finally:
            self._waiting = [one for one in self._waiting if one is not token]
            self._lock.take_back(depth)

    def notify(self, n: int = 1) -> None:
        del self._waiting[:n]

    def notify_all(self) -> None:
        self._waiting.clear()

    def __enter__(self) -> bool:
        return self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


class _Event:
    def __init__(self, turns: Turns) -> None:
        self._turns, self._is_set = turns, False

    def is_set(self) -> bool:
        return self._is_set

    def set(self) -> None:
        self._is_set = True

    def clear(self) -> None:
        self._is_set = False

    def wait(self, timeout: float | None = None) -> bool:
        return self._turns.wait(self.is_set, math.inf if timeout is None else timeout)
