"""The loop's promises, to the microsecond: on a clock that moves only by what is done."""

import select
from collections.abc import Callable
from itertools import pairwise

import pytest

from litegripd.io import loop as loop_module
from litegripd.io.loop import (
    GUARD_S,
    REQUEST_SHARE,
    ROOM_SHARE,
    SPARE_SHARE,
    STARVED_AFTER_S,
    Reactor,
)

PERIOD_S = 0.005
TIMER_FD, HANDLED_FD = 1000, 7
EPSILON_S = 1e-9


class Clock:
    """In place of `time`: it stands still but for `pass_s`."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s

    def pass_s(self, duration_s: float) -> None:
        self.now_s += duration_s


class Timer:
    """In place of the kernel's timer; to wait is to move the clock."""

    clock: Clock

    def __init__(self, period_s: float, first_s: float | None = None) -> None:
        self.period_s = period_s
        self.next_due_s = self.clock.now_s + period_s if first_s is None else first_s
        self.first_due_s = self.last_due_s = 0.0
        self.waited_s: list[float] = []

    def fileno(self) -> int:
        return TIMER_FD

    def wait(self) -> int:
        self.waited_s.append(self.clock.now_s)
        self.clock.now_s = max(self.clock.now_s, self.next_due_s)
        fired, self.first_due_s = 0, self.next_due_s
        while self.next_due_s <= self.clock.now_s + EPSILON_S:
            fired += 1
            self.last_due_s, self.next_due_s = self.next_due_s, self.next_due_s + self.period_s
        return fired

    def close(self) -> None:
        self.next_due_s = float("inf")


class Epoll:
    """In place of the kernel's: tells of the timer, and of what is put into `ready`."""

    def __init__(self, world: "Virtual") -> None:
        self._world = world
        self.polls: list[float] = []
        self.watched: set[int] = set()

    def register(self, fd: int, _mask: int = 0) -> None:
        assert fd not in self.watched
        self.watched.add(fd)

    def unregister(self, fd: int) -> None:
        self.watched.remove(fd)

    def close(self) -> None:
        pass

    def poll(self, timeout: float, _most: int) -> list[tuple[int, int]]:
        world, clock = self._world, self._world.clock
        self.polls.append(timeout)
        assert len(self.polls) < 100_000, "the loop spins"
        due_s = world.timer.next_due_s
        if timeout < 0 and clock.now_s < due_s:
            arrivals = [at_s for at_s in world.arrivals if at_s < due_s]
            clock.now_s = max(clock.now_s, min([*arrivals, due_s]))
        events = [(HANDLED_FD, select.EPOLLIN)] * sum(at <= clock.now_s for at in world.arrivals)
        is_due = clock.now_s + EPSILON_S >= due_s
        return events + [(TIMER_FD, select.EPOLLIN)] * is_due


class Work:
    """A backlog: so many requests that cost so much each; `light` of them are light users'."""

    def __init__(self, clock: Clock, cost_s: float, count: int = 0, light: int = 0) -> None:
        self._clock, self._cost_s = clock, cost_s
        self.count, self.light = count, light
        self.served_s: list[float] = []
        self.until_s: list[float] = []

    @property
    def pending(self) -> bool:
        return self.count + self.light > 0

    @property
    def pending_light(self) -> bool:
        return self.light > 0

    def serve(self, until_s: float, *, light_only: bool = False) -> None:
        if not light_only:
            self.until_s.append(until_s)
        is_in_time = self._clock.now_s < until_s
        if self.light and is_in_time:
            self.light -= 1
            self._serve_one()
        elif self.count and is_in_time and not light_only and not self.light:
            self.count -= 1
            self._serve_one()

    def _serve_one(self) -> None:
        self.served_s.append(self._clock.now_s)
        self._clock.pass_s(self._cost_s)


class Collector:
    """In place of the garbage collector: notes when it had time."""

    longest_s = 0.0

    def __init__(self) -> None:
        self.collected_s: list[float] = []
        self.calls: list[str] = []

    def freeze(self) -> None:
        self.calls.append("freeze")

    def thaw(self) -> None:
        self.calls.append("thaw")

    def collect(self, now_s: float) -> None:
        self.collected_s.append(now_s)


class Virtual:
    """A reactor whose ticks cost `tick_cost_s`; `arrivals` are when its descriptor is ready."""

    timer: Timer

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock = Clock()
        self.arrivals: list[float] = []
        self.tick_cost_s = 0.0
        self.ticks_s: list[float] = []
        self.handled_s: list[float] = []
        self.handling_s = 0.0
        self.collector = Collector()
        self.at_tick: Callable[[], None] = lambda: None
        self._most = 0
        monkeypatch.setattr(loop_module, "time", self.clock)
        monkeypatch.setattr(loop_module, "PeriodicTimer", self._make_timer)
        monkeypatch.setattr(loop_module, "GarbageCollector", lambda: self.collector)
        self.epoll = Epoll(self)
        monkeypatch.setattr(select, "epoll", lambda: self.epoll)
        Timer.clock = self.clock
        self.reactor = Reactor(PERIOD_S, self._tick)
        self.reactor.add(HANDLED_FD, self)

    def _make_timer(self, period_s: float, first_s: float | None) -> Timer:
        self.timer = Timer(period_s, first_s)
        return self.timer

    def on_event(self, _mask: int) -> None:
        del self.arrivals[0]
        self.handled_s.append(self.clock.now_s)
        self.clock.pass_s(self.handling_s)

    def _tick(self, now_s: float) -> None:
        self.ticks_s.append(now_s)
        self.clock.pass_s(self.tick_cost_s)
        if len(self.ticks_s) >= self._most:
            self.reactor.stop()
        self.at_tick()

    def run(self, ticks: int) -> None:
        self._most = ticks
        self.reactor.run(self.clock.now_s + PERIOD_S)


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Virtual:
    return Virtual(monkeypatch)


def test_a_tick_that_is_late_is_told_by_how_much(world: Virtual) -> None:
    first_s = world.clock.now_s + PERIOD_S

    def late_once() -> None:
        if len(world.ticks_s) == 2:
            world.clock.pass_s(1.4 * PERIOD_S)

    world.at_tick = late_once
    world.run(3)
    assert world.ticks_s == pytest.approx([first_s, first_s + PERIOD_S, first_s + 2.4 * PERIOD_S])
    assert world.reactor.late_s == pytest.approx(0.4 * PERIOD_S)
    assert world.reactor.lateness.worst_s == pytest.approx(0.4 * PERIOD_S)
    assert world.reactor.recent_lateness.p99_s() == pytest.approx(0.4 * PERIOD_S)
    assert world.reactor.tick_cost.worst_s == pytest.approx(1.4 * PERIOD_S)
    assert (world.reactor.ticks, world.reactor.lost_ticks) == (3, 0)
    assert world.reactor.next_tick_s == pytest.approx(first_s + 3 * PERIOD_S)


def test_a_late_tick_counts_for_a_while(world: Virtual) -> None:
    world.at_tick = lambda: world.clock.pass_s(1.4 * PERIOD_S) if len(world.ticks_s) == 2 else None
    world.run(20)
    assert world.reactor.late_s == 0.0
    assert world.reactor.recent_lateness.p99_s() == pytest.approx(0.4 * PERIOD_S)


def test_what_is_forgotten_is_not_watched_any_more(world: Virtual) -> None:
    world.reactor.remove(HANDLED_FD)
    assert world.epoll.watched == set()
    world.reactor.remove(HANDLED_FD)
    world.run(1)
    assert world.epoll.watched == set()  # neither is the timer


def test_ticks_that_are_lost_are_counted(world: Virtual) -> None:
    world.at_tick = lambda: world.clock.pass_s(3.5 * PERIOD_S) if len(world.ticks_s) == 1 else None
    world.run(3)
    assert (world.reactor.ticks, world.reactor.lost_ticks) == (5, 2)
    assert world.reactor.late_s == 0.0
    assert world.reactor.lateness.worst_s == pytest.approx(2.5 * PERIOD_S)  # of the first one


def test_requests_have_their_share_of_a_period_and_no_more(world: Virtual) -> None:
    work = world.reactor.backlog = Work(world.clock, 1e-4, count=10**6)
    began_s = world.clock.now_s
    world.run(1)
    assert work.served_s[0] == began_s
    used_s = work.served_s[-1] + 1e-4 - began_s
    assert used_s == pytest.approx(REQUEST_SHARE * PERIOD_S, abs=1.1e-4)
    assert max(work.until_s) == pytest.approx(began_s + REQUEST_SHARE * PERIOD_S)
    assert world.reactor.budget_exhausted == 1
    assert world.timer.waited_s[0] == pytest.approx(world.ticks_s[0])  # asleep till then


def test_a_loop_with_little_to_do_uses_up_nothing(world: Virtual) -> None:
    work = world.reactor.backlog = Work(world.clock, 1e-4, count=3)
    world.run(4)
    assert len(work.served_s) == 3
    assert world.reactor.budget_exhausted == 0
    assert len(world.epoll.polls) <= 4 + 3 + 1
    assert world.epoll.polls.count(-1) == 4


def test_without_a_backlog_descriptors_are_served(world: Virtual) -> None:
    arrivals = [world.clock.now_s + share * PERIOD_S for share in (0.2, 0.6, 1.3)]
    world.arrivals = list(arrivals)
    world.run(2)
    assert world.handled_s == arrivals


def test_nothing_begins_so_late_that_it_could_run_into_the_tick(world: Virtual) -> None:
    tick_s = world.clock.now_s + PERIOD_S
    work = world.reactor.backlog = Work(world.clock, 1e-5)
    world.arrivals = [tick_s - 1.5 * GUARD_S, tick_s - 0.5 * GUARD_S]
    world.at_tick = lambda: setattr(work, "count", 1)

    world.run(2)
    assert world.handled_s[0] == pytest.approx(tick_s - 1.5 * GUARD_S)
    assert world.handled_s[1] >= tick_s  # the other waits for the tick to be over
    assert work.until_s[0] == pytest.approx(tick_s - GUARD_S)


def test_once_the_time_is_over_no_further_descriptor_of_a_poll_is_served(world: Virtual) -> None:
    world.arrivals = [world.clock.now_s] * 5
    world.handling_s = 0.3 * PERIOD_S
    world.run(1)
    # Two use up 0.6 of the period, of which 0.5 are for requests; the third is in the spare time.
    assert len(world.handled_s) == 3


def test_light_requests_are_served_when_the_share_is_used_up(world: Virtual) -> None:
    work = world.reactor.backlog = Work(world.clock, 1e-4, count=10**6)
    began_s = world.clock.now_s
    light_s = began_s + 0.55 * PERIOD_S
    world.arrivals = [light_s]
    world.handling_s = 1e-6
    handled = world.on_event

    def arrive(mask: int) -> None:
        handled(mask)
        work.light += 1

    world.reactor._handlers[HANDLED_FD] = type("Arrival", (), {"on_event": staticmethod(arrive)})()
    world.run(1)
    assert work.light == 0
    assert work.served_s[-1] == pytest.approx(light_s, abs=2e-4)
    assert world.reactor.budget_exhausted == 1


def test_light_requests_have_a_bounded_share_too(world: Virtual) -> None:
    work = world.reactor.backlog = Work(world.clock, 1e-4, light=10**6)
    began_s = world.clock.now_s
    world.run(1)
    used_s = work.served_s[-1] + 1e-4 - began_s
    assert used_s == pytest.approx((REQUEST_SHARE + SPARE_SHARE) * PERIOD_S, abs=2.1e-4)


def test_a_loop_whose_ticks_take_too_long_still_serves_now_and_then(world: Virtual) -> None:
    """Else nobody could stop it any more; once every `STARVED_AFTER_S` is enough for that."""
    work = world.reactor.backlog = Work(world.clock, 1e-4, count=10**6)
    world.tick_cost_s = 1.1 * PERIOD_S
    world.run(100)
    elapsed_s = world.ticks_s[-1] - world.ticks_s[0]
    shares = elapsed_s / (STARVED_AFTER_S + REQUEST_SHARE * PERIOD_S + world.tick_cost_s)
    assert world.reactor.late_shares == pytest.approx(shares, abs=1.0)
    bursts = [
        later - earlier
        for earlier, later in pairwise(work.served_s)
        if later - earlier > 0.5 * PERIOD_S
    ]
    assert len(bursts) == world.reactor.late_shares
    assert min(bursts) >= STARVED_AFTER_S - 2 * world.tick_cost_s
    each = REQUEST_SHARE * PERIOD_S / 1e-4
    assert len(work.served_s) / (len(bursts) + 1) == pytest.approx(each, rel=0.15)


def test_a_starved_loop_hears_a_signal_or_a_stop(world: Virtual) -> None:
    world.tick_cost_s = 1.1 * PERIOD_S
    came_s = world.clock.now_s + 5 * PERIOD_S
    world.arrivals = [came_s]
    world.run(60)
    assert len(world.handled_s) == 1
    assert world.handled_s[0] - came_s <= STARVED_AFTER_S + 2 * world.tick_cost_s
    assert world.reactor.late_shares >= 1


@pytest.mark.parametrize(("room", "starves"), [(ROOM_SHARE * 1.5, False), (ROOM_SHARE * 0.5, True)])
def test_a_loop_with_room_between_its_ticks_never_serves_into_them(
    world: Virtual, room: float, starves: bool
) -> None:
    work = world.reactor.backlog = Work(world.clock, 1e-5, count=10**6)
    world.tick_cost_s = PERIOD_S * (1.0 - room) - GUARD_S
    world.run(60)
    assert (world.reactor.late_shares > 0) == starves
    assert work.served_s
    assert (world.reactor.lateness.worst_s > 1e-6) == starves


def test_garbage_is_collected_only_with_half_a_period_left(world: Virtual) -> None:
    costs = iter((0.1, 0.4, 0.6, 0.9))
    world.at_tick = lambda: world.clock.pass_s(next(costs) * PERIOD_S)
    world.run(4)
    assert [at_s > world.ticks_s[1] for at_s in world.collector.collected_s] == [False, True]
    assert world.collector.calls == ["freeze", "thaw"]


def test_a_tick_that_fails_is_counted_and_timed_all_the_same(world: Virtual) -> None:
    def fail() -> None:
        world.clock.pass_s(1e-3)
        raise ZeroDivisionError("a defect")

    world.at_tick = fail
    world.run(3)
    assert world.reactor.tick_errors == 3
    assert world.reactor.tick_cost.worst_s == pytest.approx(1e-3)


def test_stopping_within_a_request_ends_the_loop_before_the_next_one(world: Virtual) -> None:
    work = world.reactor.backlog = Work(world.clock, 1e-4, count=10**6)
    world.arrivals = [world.clock.now_s]
    end = type("End", (), {"on_event": lambda _self, _mask: world.reactor.stop()})()
    world.reactor._handlers[HANDLED_FD] = end
    world.run(1)
    assert len(work.served_s) <= 1
