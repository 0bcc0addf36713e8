"""The bus behind a process of its own: a real SLCAN adapter on a pseudo-terminal."""

import datetime as dt
import os
import select
import signal
import time
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.io.can import pumped as pumped_bus
from litegripd.io.can.pumped import (
    PumpedBus,
    pack_frames,
    pack_send_request,
    unpack_frames,
    unpack_send_request,
)
from litegripd.model.motor import BusSettings, CanFrame
from litegripd.motor.codec import status_request
from tests.sim.simulator_process import SimulatorProcess, simulator

PERIOD_S = 0.005
DEADLINE_S = 30.0
ASK = status_request(0x08)
QUICK = {"sleep_after_open": 0}

FRAMES = st.lists(st.builds(CanFrame, st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=20)


@given(FRAMES, st.floats(allow_nan=False))
def test_frames_are_the_same_after_their_journey(frames: list[CanFrame], deadline_s: float) -> None:
    assert unpack_frames(pack_frames(frames)) == frames
    assert unpack_send_request(pack_send_request(frames, deadline_s)) == (frames, deadline_s)


class Rig:
    """A pumped bus, ticked as fast as the test likes."""

    def __init__(self, channel: str, **options: object) -> None:
        settings = BusSettings("slcan", channel, 1_000_000, {**QUICK, **options})
        self.bus = PumpedBus(settings, PERIOD_S)
        self.got: list[CanFrame] = []
        self.longest_s = 0.0

    def tick(self, *frames: CanFrame) -> None:
        began_s = time.thread_time()
        now_s = time.monotonic()
        self.got += self.bus.receive(now_s)
        self.bus.send(frames, now_s)
        self.longest_s = max(self.longest_s, time.thread_time() - began_s)

    def until(self, condition: Callable[[], bool], *frames: CanFrame) -> None:
        ends_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < ends_s, f"did not happen in time: {self.bus.condition.error}"
            self.tick(*frames)

    def ask(self) -> CanFrame:
        """Ask for the motor's status until it is told."""
        self.got.clear()
        asked_s = float("-inf")

        def answered() -> bool:
            nonlocal asked_s
            if time.monotonic() > asked_s + 0.1:
                asked_s = time.monotonic()
                self.tick(ASK)
            return bool(self.got)

        self.until(answered)
        return self.got[0]


@pytest.fixture
def peer() -> Iterator[SimulatorProcess]:
    with simulator("--pty") as process:
        yield process


@pytest.fixture
def rig(peer: SimulatorProcess) -> Iterator[Rig]:
    made = Rig(peer.first_line)
    yield made
    made.bus.close()


def test_frames_pass_both_ways(rig: Rig) -> None:
    assert not rig.bus.condition.is_usable
    assert rig.bus.condition.error == "not opened yet"
    rig.tick(ASK)
    rig.until(lambda: rig.bus.condition.is_usable)
    answer = rig.ask()
    assert (answer.can_id, answer.data[0], len(answer.data)) == (0x18, 0x08, 8)
    counters = rig.bus.counters
    assert (counters.received, counters.send_failures, counters.reopened) == (1, 0, 0)


def test_a_pump_that_is_killed_is_started_again(rig: Rig) -> None:
    rig.until(lambda: rig.bus.condition.is_usable)
    first = rig.bus.pid
    assert first is not None
    os.kill(first, signal.SIGKILL)
    rig.until(lambda: not rig.bus.condition.is_usable)
    assert rig.bus.condition.error == "the pump process died"
    rig.until(lambda: rig.bus.condition.is_usable)
    assert rig.bus.pid != first
    assert rig.bus.counters.reopened == 1
    assert rig.ask().can_id == 0x18


def test_a_peer_that_is_stopped_blocks_nobody_and_is_sent_nothing_stale(
    rig: Rig, peer: SimulatorProcess
) -> None:
    rig.until(lambda: rig.bus.condition.is_usable)
    rig.ask()
    pid = peer._process.pid
    os.kill(pid, signal.SIGSTOP)
    before = rig.bus.counters.send_failures
    rig.longest_s = 0.0
    handed = 0

    def dropped() -> bool:
        nonlocal handed
        handed += 1
        return rig.bus.counters.send_failures > before + 50

    rig.until(dropped, ASK)
    assert rig.longest_s < 0.5  # processor time: a wait for the peer would have lasted for ever
    assert rig.bus.condition.is_usable
    os.kill(pid, signal.SIGCONT)
    sent = rig.bus.counters.sent
    rig.until(lambda: rig.bus.counters.sent > sent + 5, ASK)
    rig.ask()


def test_a_stopped_pump_drops_what_is_too_old_when_it_goes_on(rig: Rig) -> None:
    rig.until(lambda: rig.bus.condition.is_usable)
    rig.ask()
    pid = rig.bus.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    began_s = time.monotonic()
    for _ in range(20):
        rig.tick(ASK)
    failures = rig.bus.counters.send_failures
    rig.until(lambda: time.monotonic() > began_s + 3 * PERIOD_S)
    rig.got.clear()
    os.kill(pid, signal.SIGCONT)
    rig.until(lambda: rig.bus.counters.send_failures >= failures + 20)
    assert rig.got == []


def test_a_path_that_does_not_exist_is_named() -> None:
    rig = Rig("/dev/no-such-adapter")
    try:
        rig.until(lambda: rig.bus.condition.error != "not opened yet")
        assert rig.bus.condition.error is not None
        assert "/dev/no-such-adapter" in rig.bus.condition.error
        assert rig.bus.condition.error.startswith("cannot be opened")
        rig.until(lambda: rig.bus.pid is None)
        rig.until(lambda: rig.bus.pid is not None)
        assert rig.bus.condition.state == "adapter_gone"
    finally:
        rig.bus.close()


def test_an_option_that_json_does_not_know_does_not_end_the_control_thread(
    peer: SimulatorProcess,
) -> None:
    rig = Rig(peer.first_line, since=dt.date(2020, 1, 1))  # TOML has dates
    try:
        rig.until(lambda: rig.bus.condition.is_usable)
    finally:
        rig.bus.close()


def test_an_adapter_that_goes_away_is_told(rig: Rig, peer: SimulatorProcess) -> None:
    rig.until(lambda: rig.bus.condition.is_usable)
    peer.end(signal.SIGKILL)
    rig.until(lambda: not rig.bus.condition.is_usable, ASK)
    assert rig.bus.condition.error is not None
    assert rig.bus.condition.error.startswith(("reading", "sending"))
    assert rig.bus.condition.state == "adapter_gone"


def test_a_pump_that_cannot_be_started_is_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    starts: list[str] = []

    def impossible(module: str, _arguments: object) -> None:
        starts.append(module)
        raise OSError(11, "no processes left")

    bus = PumpedBus(BusSettings("slcan", "x", 1_000_000), PERIOD_S, impossible)  # type: ignore[arg-type]
    for now_s in (0.0, 0.1, 0.4, 0.6):
        assert bus.receive(now_s) == []
    assert starts == [pumped_bus.MODULE] * 2
    assert bus.condition.error is not None
    assert "no processes left" in bus.condition.error
    bus.close()


def test_a_pump_ends_with_its_daemon(rig: Rig) -> None:
    rig.until(lambda: rig.bus.condition.is_usable)
    assert rig.bus.pid is not None
    assert rig.bus._child is not None
    pidfd = os.pidfd_open(rig.bus.pid)
    try:
        rig.bus._child.socket.close()
        assert select.select([pidfd], [], [], DEADLINE_S)[0]
    finally:
        os.close(pidfd)
