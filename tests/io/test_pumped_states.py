"""The states of a pumped bus, by what its pump tells and when; the pump is a fake one."""

import json
from collections.abc import Callable, Sequence
from itertools import pairwise

import pytest

from litegripd.io.can.pumped import PumpedBus, pack_frames, pack_lateness
from litegripd.model.motor import BusSettings, CanFrame
from tests.io.pump_rig import FakeChild

PERIOD_S = 0.005
POLL_S = 0.05
FRAME = CanFrame(0x18, bytes(8))
OPEN = b"o"
GOT = b"f" + pack_frames((FRAME,))
DROPPED = b"d1"


class Rig:
    """A pumped bus in virtual time, which polls a motor; `reborn` is what a new pump is like."""

    def __init__(self, reborn: Callable[[FakeChild], None]) -> None:
        self.now_s = 0.0
        self.started_s: list[float] = []
        self.start_error: OSError | None = None
        self.child = FakeChild()
        self._reborn = reborn
        self.bus = PumpedBus(BusSettings("slcan", "/dev/x", 1_000_000), PERIOD_S, self._start)  # type: ignore[arg-type]

    @property
    def state(self) -> str:
        return self.bus.condition.state

    def tick(self, *says: bytes) -> None:
        self.now_s += POLL_S
        self.child.says.extend(says)
        self.bus.receive(self.now_s)
        self.bus.send((FRAME,), self.now_s)

    def run(self, duration_s: float, *says: bytes) -> None:
        """Poll for a while; the pump says `says` after each."""
        for _ in range(round(duration_s / POLL_S)):
            self.tick(*says)

    def _start(self, _module: str, _arguments: Sequence[str]) -> FakeChild:
        self.started_s.append(self.now_s)
        if self.start_error is not None:
            raise self.start_error
        self.child = FakeChild()
        self._reborn(self.child)
        return self.child


def opens(child: FakeChild) -> None:
    child.says.append(OPEN)


def dies(child: FakeChild) -> None:
    child.has_ended = True


@pytest.fixture
def rig() -> Rig:
    made = Rig(opens)
    made.tick()
    assert made.state == "up"
    return made


def test_drops_that_last_are_a_bus_that_is_stalled_until_a_frame_comes(rig: Rig) -> None:
    rig.run(1.0, DROPPED)
    assert rig.state == "up"
    rig.run(0.1, DROPPED)
    assert rig.state == "bus_stalled"
    assert "takes no frame" in str(rig.bus.condition.error)
    rig.run(60.0, DROPPED)
    assert rig.state == "bus_stalled"
    rig.tick(GOT)
    assert rig.state == "up"
    rig.run(0.9, DROPPED)
    assert rig.state == "up"


def test_one_drop_is_no_stalled_bus_though_the_motor_is_silent(rig: Rig) -> None:
    rig.tick(DROPPED)
    for _ in range(200):
        rig.tick()
        assert rig.state == "up"
    rig.tick(DROPPED)
    rig.run(0.9)
    assert rig.state == "up"


def test_a_stalled_bus_works_again_when_nothing_more_is_dropped(rig: Rig) -> None:
    rig.run(2.0, DROPPED)
    assert rig.state == "bus_stalled"
    rig.run(0.9)
    assert rig.state == "bus_stalled"
    rig.run(0.2)
    assert rig.state == "up"


def test_the_name_that_the_pump_has_told_is_not_changed_by_what_was_dropped(rig: Rig) -> None:
    rig.run(0.9, DROPPED)
    rig.tick(b'x["adapter_gone", "reading: gone"]')
    rig.run(2.0)
    assert (rig.state, rig.bus.condition.error) == ("adapter_gone", "reading: gone")


@pytest.mark.parametrize("start_error", [None, OSError(11, "no processes left")])
def test_a_pump_that_dies_or_cannot_be_started_is_started_again_ever_less_often(
    start_error: OSError | None,
) -> None:
    rig = Rig(dies)
    rig.start_error = start_error
    rig.run(40.0)
    gaps_s = [later - earlier for earlier, later in pairwise(rig.started_s)]
    assert gaps_s[:7] == pytest.approx([0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0], abs=2.5 * POLL_S)


def test_only_openings_after_the_first_are_counted_and_only_what_is_lost_since_then() -> None:
    rig = Rig(dies)
    rig.run(20.0)
    counters = rig.bus.counters
    assert len(rig.started_s) > 3
    assert (counters.reopened, counters.send_failures) == (0, 0)
    rig._reborn = opens
    rig.run(6.0)
    assert (rig.state, counters.reopened, counters.send_failures) == ("up", 0, 0)
    rig._reborn = dies
    rig.child.has_ended = True
    rig.run(20.0)
    assert counters.reopened == 0
    assert counters.send_failures == 20.0 / POLL_S
    rig._reborn = opens
    rig.run(6.0)
    assert (rig.state, counters.reopened) == ("up", 1)


def test_a_pump_that_opens_its_adapter_is_soon_started_again() -> None:
    rig = Rig(dies)
    rig.run(20.0)
    rig._reborn = opens
    rig.run(6.0)
    assert rig.state == "up"
    rig.child.has_ended = True
    rig.run(0.1)
    assert rig.state == "down"
    rig.run(0.6)
    assert rig.state == "up"


def test_frames_that_the_pump_itself_was_late_for_are_no_blocked_adapter(rig: Rig) -> None:
    rig.run(2.0, pack_lateness(0.023), b"w1")
    assert rig.state == "up"
    assert rig.bus.counters.send_failures == 40
    error = rig.bus.condition.error or ""
    assert "waited up to 23 ms" in error
    assert "rights" not in error
    assert rig.bus.lateness.worst_s() == 0.023
    rig.run(29.0)
    assert rig.bus.condition.error is not None
    rig.run(2.0)
    assert rig.bus.condition.error is None


def test_a_late_pump_without_real_time_rights_says_so(rig: Rig) -> None:
    rig.tick(b"r", pack_lateness(0.023), b"w1")
    assert "no real-time rights" in (rig.bus.condition.error or "")


def test_what_the_pump_doubts_is_told_while_the_bus_is_up(rig: Rig) -> None:
    rig.tick(b"?nothing has come")
    assert (rig.state, rig.bus.condition.error) == ("up", "nothing has come")
    rig.tick(GOT)
    assert rig.bus.condition.error == "nothing has come"
    rig.tick(b"?")
    assert rig.bus.condition.error is None


def test_what_a_newer_pump_reports_does_no_harm(rig: Rig) -> None:
    rig.tick(b"Nonsense", GOT)
    assert (rig.state, rig.bus.counters.received) == ("up", 1)


def test_the_pump_runs_just_below_the_control_thread() -> None:
    rig = Rig(opens)
    given: list[list[object]] = []

    def start(_module: str, arguments: Sequence[str]) -> FakeChild:
        given.append(json.loads(arguments[0]))
        return FakeChild()

    for priority, wanted in ((50, 48), (2, 1), (0, 0)):
        settings = BusSettings("slcan", "/dev/x", 1_000_000)
        PumpedBus(settings, PERIOD_S, start, priority).receive(rig.now_s)  # type: ignore[arg-type]
        assert given[-1][-2:] == [2 * PERIOD_S, wanted]
