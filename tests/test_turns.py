"""Threads that take turns in virtual time: their order, what they wait for, and how they end."""

from typing import Any

import pytest

from tests.turns import Deadlock, Turns

PERIOD_S = 0.005


class Clock:
    """A time that passes by periods, and turns in it; `at` is what happens then."""

    def __init__(self, most_s: float = 60.0) -> None:
        self.now_s = 0.0
        self.at: dict[float, BaseException] = {}
        self.turns = Turns(self.tick, lambda: self.now_s, most_s)
        self.said: list[tuple[float, str]] = []

    def tick(self) -> None:
        self.now_s = round(self.now_s + PERIOD_S, 6)
        if self.now_s in self.at:
            raise self.at.pop(self.now_s)

    def say(self, what: str) -> None:
        self.said.append((self.now_s, what))

    def start(self, function: Any, *arguments: Any, daemon: bool = False) -> Any:
        thread = self.turns.threading.Thread(
            target=function, args=arguments, daemon=daemon, name=function.__name__
        )
        thread.start()
        return thread


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_threads_go_on_in_the_order_in_which_they_were_started(clock: Clock) -> None:
    def say_twice(name: str) -> None:
        for _ in range(2):
            clock.say(name)
            clock.turns.sleep(0.01)

    with clock.turns:
        for name in ("a", "b", "c"):
            clock.start(say_twice, name)
        clock.say("main")
    assert clock.said == [(0.0, "main"), *((at_s, name) for at_s in (0.0, 0.01) for name in "abc")]


def test_a_wait_is_never_shorter_than_asked_for(clock: Clock) -> None:
    """Else who waits for the rest of a time, again and again, would never get to its end."""
    for asked_s, lasts_s in (
        *((0.0, 0.0), (-1.0, 0.0), (1e-12, 0.005), (0.001, 0.005)),
        *((0.02, 0.02), (0.021, 0.025)),
    ):
        began_s = clock.now_s
        clock.turns.sleep(asked_s)
        assert clock.now_s - began_s == pytest.approx(lasts_s)


def test_what_a_thread_waits_for(clock: Clock) -> None:
    threading = clock.turns.threading
    event, lock, condition = threading.Event(), threading.Lock(), threading.Condition()

    def use() -> None:
        with lock:
            clock.turns.sleep(0.1)
        event.set()
        clock.turns.sleep(0.1)
        with condition:
            condition.notify_all()

    with clock.turns:
        thread = clock.start(use)
        assert not thread.join(0.05)
        assert thread.is_alive()
        assert not lock.acquire(blocking=False)
        assert not lock.acquire(timeout=0.01)
        assert not event.wait(0.01)
        assert clock.now_s == pytest.approx(0.07)
        with lock:
            assert clock.now_s == pytest.approx(0.1)
        assert event.wait()
        with condition:
            assert not condition.wait(0.03)
            assert clock.now_s == pytest.approx(0.13)
            assert condition.wait()
        thread.join()
        assert not thread.is_alive()
    assert clock.now_s == pytest.approx(0.2)


def test_a_lock_can_be_taken_again_where_that_is_its_kind(clock: Clock) -> None:
    lock = clock.turns.threading.RLock()

    def take() -> None:
        with lock:
            clock.say("taken")

    with clock.turns:
        with lock, lock:
            clock.start(take)
            clock.turns.sleep(0.05)
        clock.turns.sleep(0.0)
    assert clock.said == [(0.05, "taken")]
    with pytest.raises(RuntimeError, match="nobody"):
        lock.release()


def test_a_queue(clock: Clock) -> None:
    module = clock.turns.modules()["queue"]
    queue = module.Queue(maxsize=2)

    def put() -> None:
        for number in range(5):
            queue.put(number)
            clock.say(f"put {number}")

    with clock.turns:
        clock.start(put)
        clock.turns.sleep(0.1)
        assert clock.said == [(0.0, "put 0"), (0.0, "put 1")]
        assert [queue.get() for _ in range(5)] == [0, 1, 2, 3, 4]
        with pytest.raises(module.Empty):
            queue.get(timeout=0.5)
    assert clock.now_s == pytest.approx(0.6)


def test_an_error_in_a_thread_ends_the_main_one(clock: Clock) -> None:
    def fail() -> None:
        clock.turns.sleep(0.1)
        raise ValueError("a thread's")

    def leave() -> None:
        raise SystemExit

    with clock.turns:
        thread = clock.start(fail)
        clock.start(leave)
        with pytest.raises(ValueError, match="a thread's"):
            clock.turns.sleep(1.0)
        assert clock.now_s == pytest.approx(0.1)
        assert not thread.is_alive()
    with pytest.raises(ValueError, match="a thread's"), clock.turns:
        clock.start(fail)


def test_what_happens_meanwhile_is_raised_in_the_main_thread(clock: Clock) -> None:
    """As an interrupt is, whichever thread is waiting."""
    clock.at[0.05] = KeyboardInterrupt()
    with clock.turns:
        thread = clock.start(clock.turns.sleep, 0.1)
        with pytest.raises(KeyboardInterrupt):
            thread.join()
        assert clock.now_s == pytest.approx(0.05)
        thread.join()
    assert clock.now_s == pytest.approx(0.1)


def test_a_deadlock_is_told(clock: Clock) -> None:
    first, second = (clock.turns.threading.Lock() for _ in range(2))

    def other_way_round() -> None:
        with second:
            clock.turns.sleep(0.01)
            with first:
                pytest.fail("nobody holds it back")

    with clock.turns:
        clock.start(other_way_round, daemon=True)
        with first:
            clock.turns.sleep(0.01)
            with pytest.raises(Deadlock, match="main, other_way_round"):
                second.acquire()
    assert clock.now_s < 1.0


def test_threads_that_come_to_no_end_are_told(clock: Clock) -> None:
    def poll() -> None:
        while True:
            clock.turns.sleep(1.0)

    with pytest.raises(Deadlock, match=r"main, poll go on for 60 s"), clock.turns:
        clock.start(poll)
    assert clock.now_s < 70.0


def test_a_daemonic_thread_ends_with_the_program(clock: Clock) -> None:
    def poll() -> None:
        try:
            while True:
                clock.turns.sleep(1.0)
        finally:
            clock.say("over")

    with clock.turns:
        threads = [clock.start(poll, daemon=True) for _ in range(2)]
        clock.turns.sleep(3.0)
    assert clock.said == [(3.0, "over")] * 2
    assert not any(thread.is_alive() for thread in threads)
    with clock.turns:  # and another can be run
        clock.start(clock.say, "again").join()
