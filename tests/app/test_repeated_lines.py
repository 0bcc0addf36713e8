"""A part that flaps for a day fills no journal: its lines repeat at intervals that grow."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from litegrip_client.values.repeats import RepeatsHandler
from litegripd.app.machine import Ending
from litegripd.app.status import MotorGreeting, log_event
from litegripd.model.gripper import DM4310
from litegripd.model.motor import UP, BusCondition
from litegripd.model.state import Event, EventKind
from tests.motor.bench import everything, nothing
from tests.properties import NIGHTLY, chosen
from tests.world import World

DAY_S = 86_400.0
GONE = BusCondition("adapter_gone", "there is no network interface can0")
FIELDS_BYTES = 134
"""Of a line's datagram to the journal, beside its text: the most of what a flap writes."""


@dataclass
class Day:
    """A log handler on a clock of its own, and the lines that it has written, with their times."""

    now_s: float = 0.0
    lines: list[tuple[float, str]] = field(default_factory=list)
    given: int = 0
    stamps_s: list[float] = field(default_factory=list)
    """What each line says of its time, by the machine's clock."""

    def __post_init__(self) -> None:
        self.handler = RepeatsHandler(self._take, lambda: self.now_s)

    def _take(self, record: logging.LogRecord, text: str) -> bool:
        self.lines.append((self.now_s, text))
        self.stamps_s.append(record.created)
        return True

    def until(self, at_s: float) -> None:
        """Let time pass, as the ticks do."""
        while self.now_s < at_s:
            self.now_s = min(self.now_s + 1.0, at_s)
            self.handler.poll()

    def say(self, *events: Event) -> None:
        for event in events:
            self.given += 1
            log_event(event, "can0")

    @property
    def texts(self) -> list[str]:
        return [text for _at_s, text in self.lines]

    @property
    def written_bytes(self) -> int:
        return sum(len(text.encode()) + FIELDS_BYTES for text in self.texts)


@pytest.fixture
def day(monkeypatch: pytest.MonkeyPatch) -> Iterator[Day]:
    made = Day()
    ours = logging.getLogger("litegripd")
    monkeypatch.setattr(ours, "handlers", [made.handler])
    monkeypatch.setattr(ours, "propagate", False)
    level = ours.level
    ours.setLevel(logging.INFO)
    yield made
    ours.setLevel(level)


def flap(out_s: float) -> tuple[Event, ...]:
    """Return what the daemon reports when the plug of an enabled gripper is out and in again."""
    world = World()
    world.enabled()
    world.run(1.0)
    world.take_log()
    events: list[Event] = []
    for condition in (GONE, UP):
        world.condition = condition
        world.lose_to_motor = everything if condition is GONE else nothing
        for _ in range(10):
            world.run(out_s / 10.0)
            events += world.take_log()
    assert [event for event in events if event.kind == "job_started"] == []
    assert {event.kind for event in events} >= {"bus", "motor"}
    return tuple(events)


@pytest.mark.parametrize("every_s", [*([2.0] if chosen() == NIGHTLY else []), 30.0, 300.0])
def test_a_plug_that_is_loose_for_a_day_fills_no_journal(every_s: float, day: Day) -> None:
    events = flap(1.0)
    for number in range(round(DAY_S / every_s)):
        day.until(number * every_s)
        day.say(*events)
    assert day.given == len(events) * round(DAY_S / every_s)
    print(f"{every_s:g} s: {len(day.lines)} lines, {day.written_bytes / 1e3:.0f} kB")
    assert 0 < day.written_bytes < 100e3
    assert sum("it is opened as soon as it is there" in text for text in day.texts) == 1


def test_every_repeat_is_counted(day: Day) -> None:
    event = Event("motor", "motor: enabled -> silent: it does not answer", {"error": "x"})
    for number in range(1000):
        day.until(number * 7.0)
        day.say(event)
    day.handler.close()
    first, *others = day.texts
    assert first == event.message
    counted = [text.partition("(again: ")[2].split()[0] for text in others]
    assert sum(1 if number == "once" else int(number) for number in counted) == 999
    assert others[0] == f"{event.message} (again: once in 10 s, the last 3 s ago)"


def test_what_was_counted_stands_before_the_end_and_never_behind_it(day: Day) -> None:
    """Below "ending", "enabling -> enabled (again: ...)" would read as if it were enabled now."""
    event = Event("motor", "motor: enabling -> enabled", {})
    for _ in range(2):
        day.say(event)
    world = World().start()
    Ending(world.machine).begin(world.now_s)
    day.handler.close()
    assert [text.partition(" (again")[0] for text in day.texts] == [
        event.message,
        event.message,
        "ending: the motor is being disabled",
    ]


def test_the_first_is_written_at_once_and_in_full_and_so_is_one_after_a_long_time(
    day: Day,
) -> None:
    long = Event("bus", "CAN bus: up -> adapter_gone: " + "what to do; " * 30, {"error": "x"})
    day.say(long, long)
    assert day.texts == [long.message]
    day.until(3700.0)
    assert len(day.lines) == 2
    assert len(day.texts[1]) < 170
    assert day.texts[1].startswith(long.message[:100])
    day.say(long)
    assert day.lines[2:] == [(3700.0, long.message)]


def test_what_was_counted_is_told_soon_after_it_has_settled(day: Day) -> None:
    """The journal's end must not be an hour old: the plug may stay out this time."""
    event = Event("bus", "CAN bus: up -> adapter_gone", {"error": "x"})
    for number in range(3000):
        day.until(number * 2.0)
        day.say(event)
    last_s = day.now_s
    day.until(last_s + 3600.0)
    assert last_s <= day.lines[-1][0] <= last_s + 601.0


def test_what_was_counted_bears_the_time_at_which_it_is_told(day: Day) -> None:
    gone = Event("bus", "CAN bus: adapter_gone", {"state": "adapter_gone"})
    day.say(gone, gone)
    day.until(30.0)
    (_, first_s), (told_s, stamp_s) = zip(day.lines, day.stamps_s, strict=True)
    assert stamp_s - first_s == pytest.approx(told_s[0], abs=1.0)


def test_figures_do_not_make_another_line(day: Day) -> None:
    for number in range(100):
        day.say(Event("refused", f"refused job (pid {number}): {number / 10} mm is too far", {}))
    assert len(day.lines) == 1
    day.until(11.0)
    assert day.texts[1] == (
        "refused job (pid 99): 9.9 mm is too far (again: 99 times in 10 s, the last 10 s ago)"
    )


@pytest.mark.parametrize("kind", ["stop", "released_by_fault", "object_lost"])
def test_a_stop_and_a_lost_object_are_logged_each_time(kind: EventKind, day: Day) -> None:
    day.say(*[Event(kind, "it has happened", {"warning": True})] * 5)
    assert day.texts == ["it has happened"] * 5


def test_what_people_do_is_logged_each_time(day: Day) -> None:
    day.say(*[Event("job_started", f"job {number}: grasp by x", {}) for number in range(5)])
    assert len(day.lines) == 5


def test_a_motor_that_is_found_again_and_again_is_greeted_once(day: Day) -> None:
    world = World().start()
    greeting = MotorGreeting(DM4310)
    for _ in range(50):
        greeting.note(world.machine.motor.view().identity)
        greeting.note(None)
    assert sum("answers on" in text for text in day.texts) == 1


def test_the_number_of_kinds_that_are_kept_is_bounded_and_loses_no_count(day: Day) -> None:
    for number in range(1000):
        name = "".join(chr(97 + int(digit)) for digit in str(number))
        event = Event("refused", f"refused {name}", {})
        day.say(event, event)
    day.handler.close()
    assert sum("again: once" in text for text in day.texts) == 1000
