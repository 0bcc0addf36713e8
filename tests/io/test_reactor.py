"""The loop: ticks at absolute times, a bounded share for requests, and no defect that ends it."""

import itertools
import os
import select
import signal
import time
from collections.abc import Callable, Iterator

import pytest

from litegripd.io.loop import APART_SHARE, REQUEST_SHARE, PeriodicTimer, Reactor, Signals
from litegripd.io.meters import LatenessMeter

pytestmark = pytest.mark.alone

PERIOD_S = 0.005


class Greedy:
    """A backlog that is never empty and takes all the time that it is given."""

    def __init__(self) -> None:
        self.pending = True
        self.pending_light = False
        self.used_s = 0.0
        self.ends: list[float] = []

    def serve(self, until_s: float, *, light_only: bool = False) -> None:
        if light_only:
            assert not self.pending_light, until_s
            return
        began_s = time.monotonic()
        while time.monotonic() < until_s:
            pass
        self.ends.append(until_s)
        self.used_s += time.monotonic() - began_s


class Failing:
    """A backlog with a defect."""

    pending = pending_light = True

    def serve(self, until_s: float, *, light_only: bool = False) -> None:
        raise ZeroDivisionError("a defect")


class Pipe:
    """A handler of a pipe's reading end."""

    def __init__(self, on_data: Callable[[bytes], None]) -> None:
        self.reader, self.writer = os.pipe()
        self._on_data = on_data

    def on_event(self, _mask: int) -> None:
        self._on_data(os.read(self.reader, 100))

    def close(self) -> None:
        os.close(self.reader)
        os.close(self.writer)


class Ticks:
    """Counts ticks and ends the loop after a number of them."""

    def __init__(self, count: int, period_s: float = PERIOD_S) -> None:
        self.times: list[float] = []
        self.count = count
        self.at_tick: Callable[[], None] = lambda: None
        self.reactor = Reactor(period_s, self.tick)

    def tick(self, now_s: float) -> None:
        self.times.append(now_s)
        if len(self.times) >= self.count:
            self.reactor.stop()
        self.at_tick()


@pytest.fixture
def ticks() -> Iterator[Ticks]:
    made = Ticks(20)
    yield made
    made.reactor.close()


def test_ticks_come_at_absolute_times(ticks: Ticks) -> None:
    began_s = time.monotonic()
    ticks.reactor.run()
    reactor = ticks.reactor
    assert reactor.ticks == 20 + reactor.lost_ticks
    assert ticks.times[0] >= began_s + PERIOD_S
    for number, at_s in enumerate(ticks.times):
        assert at_s >= began_s + (number + 1) * PERIOD_S
    assert ticks.times[-1] - began_s >= 20 * PERIOD_S


def test_a_late_tick_does_not_shift_the_next(ticks: Ticks) -> None:
    """Half a period of work in every tick must not slow the rate down."""

    def busy() -> None:
        until_s = time.monotonic() + PERIOD_S / 2
        while time.monotonic() < until_s:
            pass

    ticks.at_tick = busy
    ticks.reactor.run()
    passed = (ticks.times[-1] - ticks.times[0]) / PERIOD_S
    assert ticks.reactor.ticks >= passed - 4  # a shift of half a period each would lose ten


def test_lost_ticks_are_counted_not_made_up_for(ticks: Ticks) -> None:
    def busy() -> None:
        until_s = time.monotonic() + 3.5 * PERIOD_S
        while time.monotonic() < until_s and len(ticks.times) == 5:
            pass

    ticks.at_tick = busy
    ticks.reactor.run()
    assert ticks.reactor.lost_ticks >= 2
    assert len(ticks.times) == 20
    assert ticks.reactor.ticks == 20 + ticks.reactor.lost_ticks


def test_a_tick_after_lost_ones_is_as_late_as_the_first_of_them(ticks: Ticks) -> None:
    """How long the loop stood still is what its lateness says, not the rest of a period."""
    late_s: list[float] = []
    stood_still_s = 0.0

    def busy() -> None:
        nonlocal stood_still_s
        late_s.append(ticks.reactor.late_s)
        if len(ticks.times) == 5:
            due_s = ticks.reactor.next_tick_s
            while time.monotonic() < due_s + 3.5 * PERIOD_S:
                pass
            stood_still_s = time.monotonic() - due_s

    ticks.at_tick = busy
    ticks.reactor.run()
    assert late_s[5] >= stood_still_s >= 3.5 * PERIOD_S
    assert ticks.reactor.lateness.worst_s >= late_s[5]
    assert ticks.reactor.recent_lateness.worst_s() == ticks.reactor.lateness.worst_s
    assert all(late > 0.0 for late in late_s)


def test_requests_get_a_bounded_share_of_each_period(ticks: Ticks) -> None:
    greedy = Greedy()
    ticks.reactor.backlog = greedy
    ticks.reactor.run()
    assert len(ticks.times) == 20
    assert ticks.reactor.budget_exhausted > 0
    asked = [end - tick for end, tick in zip(greedy.ends[1:], ticks.times, strict=False)]
    assert max(asked) <= PERIOD_S
    assert REQUEST_SHARE <= 0.5


def test_a_defect_in_the_tick_is_logged_once_and_counted(
    ticks: Ticks, caplog: pytest.LogCaptureFixture
) -> None:
    def broken() -> None:
        raise ZeroDivisionError("a defect")

    ticks.at_tick = broken
    ticks.reactor.run()
    assert ticks.reactor.tick_errors == 20
    assert caplog.text.count("the tick failed") == 1
    assert "ZeroDivisionError" in caplog.text


def test_a_defect_in_the_backlog_is_logged_once_and_counted(
    ticks: Ticks, caplog: pytest.LogCaptureFixture
) -> None:
    ticks.reactor.backlog = Failing()
    ticks.reactor.run()
    assert len(ticks.times) == 20
    assert ticks.reactor.backlog_errors > 1
    assert caplog.text.count("further failures are only counted") == 1


def test_a_defect_in_a_handler_ends_only_that_handler(
    ticks: Ticks, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[bytes] = []

    def broken(_data: bytes) -> None:
        raise ZeroDivisionError("a defect")

    bad, good = Pipe(broken), Pipe(got.append)
    for pipe in (bad, good):
        ticks.reactor.add(pipe.reader, pipe)
    os.write(bad.writer, b"x")

    def write() -> None:
        for pipe in (bad, good):
            os.write(pipe.writer, b"y")

    ticks.at_tick = write
    ticks.reactor.run()
    assert len(ticks.times) == 20
    assert b"".join(got).count(b"y") >= 18
    assert caplog.text.count("is no longer served") == 1
    ticks.reactor.remove(bad.reader)  # a second time: nothing to do
    ticks.reactor.remove(good.reader)
    bad.close()
    good.close()


def test_a_removed_descriptor_is_not_served(ticks: Ticks) -> None:
    got: list[bytes] = []
    pipe = Pipe(got.append)
    ticks.reactor.add(pipe.reader, pipe, select.EPOLLIN)
    ticks.reactor.remove(pipe.reader)
    os.write(pipe.writer, b"x")
    ticks.reactor.run()
    assert got == []
    pipe.close()


def test_a_signal_is_an_event_of_the_loop(ticks: Ticks) -> None:
    got: list[int] = []
    before = signal.getsignal(signal.SIGUSR2)
    signals = Signals({signal.SIGUSR2: lambda: got.append(len(ticks.times))})
    ticks.reactor.add(signals.fileno(), signals)
    os.kill(os.getpid(), signal.SIGUSR2)
    assert got == []
    ticks.reactor.run()
    assert len(got) == 1
    ticks.reactor.remove(signals.fileno())
    signals.close()
    assert signal.getsignal(signal.SIGUSR2) is signal.SIG_IGN
    signal.signal(signal.SIGUSR2, before)


def test_a_tick_that_is_hastened_does_not_wait_for_its_time() -> None:
    """By a handler and by the backlog; an hour later this test would have been ended."""
    for by_backlog in (False, True):
        ticks = Ticks(1, period_s=3600.0)
        greedy = Greedy()
        pipe = Pipe(lambda _data, one=ticks: one.reactor.hasten())  # type: ignore[misc]
        if by_backlog:
            greedy.serve = lambda _until_s, one=ticks, **_light: one.reactor.hasten()  # type: ignore[method-assign]
        else:
            greedy.pending = False
            ticks.reactor.add(pipe.reader, pipe)
            os.write(pipe.writer, b"x")
        ticks.reactor.backlog = greedy
        ticks.reactor.run()
        assert len(ticks.times) == 1
        assert ticks.reactor.lost_ticks == 0
        assert greedy.ends == [], "with a tick to be done at once, nothing else is served"
        ticks.reactor.close()
        pipe.close()


def test_who_hastens_all_the_time_gets_no_flood_of_ticks() -> None:
    """Of two ticks in a row one waits for its time, which is a period after the one before."""
    ticks = Ticks(9, period_s=0.03)
    due_s: list[float] = []
    pipe = Pipe(lambda _data: None)
    pipe.on_event = lambda _mask: ticks.reactor.hasten()  # type: ignore[method-assign]
    os.write(pipe.writer, b"x")  # never read

    def note() -> None:
        due_s.append(ticks.reactor.next_tick_s)
        ticks.reactor.hasten()  # in a tick: nothing

    ticks.at_tick = note
    ticks.reactor.add(pipe.reader, pipe)
    ticks.reactor.run()
    early = [at_s < by_s for at_s, by_s in zip(ticks.times[1:], due_s, strict=False)]
    assert any(early)
    assert not any(one and other for one, other in itertools.pairwise(early))
    apart = [later - sooner for sooner, later in itertools.pairwise(ticks.times)]
    assert min(apart) >= APART_SHARE * 0.03
    assert ticks.reactor.lateness.summary_us()["worst_us"] is not None
    ticks.reactor.close()
    pipe.close()


def test_the_timer_knows_when_its_firings_were_due() -> None:
    began_s = time.monotonic()
    timer = PeriodicTimer(0.002)
    try:
        first_s = timer.next_due_s
        assert first_s >= began_s + 0.002
        fired = timer.wait()
        assert time.monotonic() >= first_s
        assert timer.last_due_s == pytest.approx(first_s + (fired - 1) * 0.002, abs=1e-9)
        while timer.last_due_s < first_s + 0.02:
            assert timer.wait() >= 1
            assert time.monotonic() >= timer.last_due_s
        assert timer.next_due_s == pytest.approx(timer.last_due_s + 0.002, abs=1e-9)
        while (fired := timer.wait()) < 3:
            while time.monotonic() < timer.next_due_s + 0.005:
                pass
        first_s = timer.last_due_s - (fired - 1) * 0.002
        assert timer.first_due_s == pytest.approx(first_s, abs=1e-9)
    finally:
        timer.close()


def test_the_timer_is_readable_only_when_it_is_due() -> None:
    timer = PeriodicTimer(3600.0)
    try:
        assert select.select([timer.fileno()], [], [], 0)[0] == []
    finally:
        timer.close()


def test_a_timer_that_the_kernel_refuses_raises() -> None:
    with pytest.raises(OSError, match="Invalid argument"):
        PeriodicTimer(-1e6)


def test_a_meter_tells_the_edges_of_its_buckets_and_the_exact_worst() -> None:
    meter = LatenessMeter()
    assert meter.summary_us() == {
        "p50_us": None,
        "p99_us": None,
        "p99_9_us": None,
        "worst_us": None,
    }
    for _ in range(98):
        meter.add(95e-6)
    meter.add(-1e-6)
    meter.add(0.25)
    assert meter.percentiles_s((0.0, 0.5, 0.99)) == pytest.approx([0.0, 1e-4, 1e-4])
    assert meter.summary_us()["worst_us"] == 250_000.0
    assert meter.percentiles_s((1.0,)) == pytest.approx([0.01])


def test_a_meter_never_tells_more_than_the_worst() -> None:
    meter = LatenessMeter()
    meter.add(3e-6)
    assert meter.percentiles_s((0.5, 0.999)) == [3e-6, 3e-6]
