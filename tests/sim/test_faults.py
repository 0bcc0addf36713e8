"""What a bus object raises, receives and loses for each fault of the link, and what recovers."""

import contextlib
import errno
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise

import can
import pytest

from litegripd.model.frame import CanFrame
from litegripd.sim.channel import FRAME_TIME_S
from litegripd.sim.faults import BUS_OFF_ID, TX_QUEUE_FRAMES
from litegripd.sim.frame_faults import FrameFaults
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import SimulatedBus
from tests.sim.driving import ENABLE, STATUS, command, decode

A_WHILE_S = 0.01


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Rig:
    """A bus object on a clock that the test turns, and what came to the motor."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.at_motor: list[tuple[float, CanFrame]] = []
        self.gripper = SimulatedGripper()
        deliver = self.gripper.receive

        def receive(now_s: float, frame: CanFrame) -> list[CanFrame]:
            self.at_motor.append((now_s, frame))
            return deliver(now_s, frame)

        self.gripper.receive = receive  # type: ignore[method-assign]
        self.bus = self.open()
        self.faults = self.bus.faults

    def open(self) -> SimulatedBus:
        return SimulatedBus("faulty", gripper=self.gripper, monotonic_fn=self.clock)

    def send(self, frame: CanFrame = STATUS, bus: SimulatedBus | None = None) -> None:
        (bus or self.bus).send(
            can.Message(arbitration_id=frame.can_id, is_extended_id=False, data=frame.data)
        )

    def wait(self, duration_s: float = A_WHILE_S) -> None:
        self.clock.now_s += duration_s

    def received(self, bus: SimulatedBus | None = None) -> list[can.Message]:
        found = []
        while (message := (bus or self.bus).recv(0)) is not None:
            found.append(message)
        return found

    def answers(self, frame: CanFrame = STATUS) -> int:
        """Send a frame; return how many answers have come after a while."""
        self.send(frame)
        self.wait()
        return len(self.received())

    def works(self) -> bool:
        return self.answers() == 1


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig()
    yield made
    made.faults.replug()
    made.bus.shutdown()


def code_of(act: Callable[[], object]) -> int | None:
    """Return the code of the error that python-can raises; it is no `OSError`."""
    with pytest.raises(can.CanOperationError) as raised:
        act()
    assert not isinstance(raised.value, OSError)
    return raised.value.error_code


def test_a_link_that_is_down_says_so_once_in_receiving_and_always_in_sending(rig: Rig) -> None:
    rig.send()
    rig.faults.link_down()
    assert code_of(lambda: rig.bus.recv(0)) == errno.ENETDOWN == 100
    assert [code_of(rig.send) for _ in range(3)] == [100] * 3
    rig.wait()
    assert rig.received() == []  # not even the answer that was under way
    came = len(rig.at_motor)
    rig.faults.link_up()
    rig.wait()
    assert rig.received() == []
    assert len(rig.at_motor) == came
    assert rig.works()


def test_a_link_that_was_down_for_a_moment_is_told_of_all_the_same(rig: Rig) -> None:
    rig.faults.link_down()
    rig.faults.link_down()
    rig.faults.link_up()
    assert code_of(lambda: rig.bus.recv(0)) == 100
    assert rig.works()


def test_a_bus_that_is_opened_while_the_link_is_down_learns_it(rig: Rig) -> None:
    rig.faults.link_down()
    with rig.open() as other:
        assert code_of(lambda: other.recv(0)) == 100
        assert other.recv(0) is None
        rig.faults.link_up()
        rig.send(bus=other)
        rig.wait()
        assert len(rig.received(other)) == 1


def test_an_unplugged_adapter_is_gone_for_this_bus_object_for_ever(rig: Rig) -> None:
    rig.send()
    rig.wait()
    rig.faults.unplug()
    assert code_of(lambda: rig.bus.recv(0)) == errno.ENODEV == 19
    assert [code_of(rig.send) for _ in range(2)] == [errno.ENXIO] * 2 == [6] * 2
    with pytest.raises(OSError, match="No such device") as raised:
        rig.open()
    assert type(raised.value) is OSError
    assert raised.value.errno == 19
    rig.faults.replug()
    rig.wait()
    assert rig.received() == []
    assert code_of(rig.send) == 6
    with rig.open() as fresh:
        rig.send(bus=fresh)
        rig.wait()
        assert len(rig.received(fresh)) == 1
        rig.faults.link_down()
        rig.faults.link_up()
        assert rig.received() == []  # the old one hears nothing of what befalls the new one


def test_an_unplugged_adapter_is_gone_for_who_closes_and_opens_again(rig: Rig) -> None:
    rig.faults.unplug()
    rig.bus.shutdown()
    with pytest.raises(OSError, match="No such device"):
        rig.open()
    rig.faults.replug()
    rig.bus = rig.open()
    assert rig.bus.faults is rig.faults
    assert rig.works()


def test_who_waits_for_a_frame_is_woken_by_the_loss_of_the_link() -> None:
    with SimulatedBus("woken") as bus:
        codes: list[int | None] = []
        thread = threading.Thread(target=lambda: codes.append(code_of(lambda: bus.recv(20.0))))
        thread.start()
        bus.faults.link_down()
        thread.join(10.0)
        assert not thread.is_alive()
    assert codes == [100]


def test_bus_off_is_one_error_frame_and_then_sends_vanish(rig: Rig) -> None:
    rig.faults.bus_off()
    rig.faults.bus_off()
    (error,) = rig.received()
    assert error.is_error_frame
    assert error.arbitration_id == BUS_OFF_ID == 0x40
    for _ in range(3 * TX_QUEUE_FRAMES):
        assert rig.answers() == 0
    assert rig.at_motor == []
    rig.faults.recover()
    rig.wait()
    assert rig.received() == []
    assert rig.at_motor == []
    assert rig.works()


def test_without_an_acknowledgement_frames_wait_and_are_all_sent_later(rig: Rig) -> None:
    rig.faults.stall()
    sent = [command(q=number * 0.1) for number in range(TX_QUEUE_FRAMES)]
    for frame in sent:
        rig.send(frame)
    assert [code_of(rig.send) for _ in range(2)] == [errno.ENOBUFS] * 2 == [105] * 2
    rig.wait(3.0)
    assert rig.received() == []
    assert rig.at_motor == []
    rig.faults.unstall()
    assert [frame for _, frame in rig.at_motor] == sent
    rig.wait()
    assert len(rig.received()) == len(sent)
    assert rig.works()


def test_what_waits_for_an_acknowledgement_does_not_outlive_the_link(rig: Rig) -> None:
    rig.faults.stall()
    rig.send()
    rig.faults.link_down()
    rig.faults.link_up()
    rig.faults.unstall()
    assert rig.at_motor == []
    assert code_of(lambda: rig.bus.recv(0)) == 100
    assert rig.works()


def test_an_error_frame_may_look_like_the_motor_s_feedback(rig: Rig) -> None:
    rig.bus.set_filters([{"can_id": 0x123, "can_mask": 0x7FF}])
    rig.faults.inject_error(0x2000_0000 | 0x08 | 0x10)
    (error,) = rig.received()
    assert error.is_error_frame
    assert error.arbitration_id == 0x18
    assert len(error.data) == 8


def test_a_second_master_is_heard_by_all_and_obeyed_by_the_motor(rig: Rig) -> None:
    rig.faults.to_motor.drop(1.0)
    rig.faults.inject(command(tau=0.5))
    rig.faults.inject(ENABLE)
    rig.wait()
    heard = rig.received()
    assert [found.arbitration_id for found in heard] == [0x08, 0x18, 0x08, 0x18]
    assert all(found.is_rx for found in heard)
    assert decode(CanFrame(0x18, bytes(heard[-1].data))).status == 1


class TestFrames:
    """Faults of single frames, by direction."""

    def test_dropped_on_the_way_to_the_motor(self, rig: Rig) -> None:
        rig.faults.to_motor.drop_next(2)
        assert [rig.answers() for _ in range(3)] == [0, 0, 1]
        assert len(rig.at_motor) == 1

    def test_dropped_on_the_way_from_the_motor(self, rig: Rig) -> None:
        rig.faults.from_motor.drop_next(2)
        assert [rig.answers() for _ in range(3)] == [0, 0, 1]
        assert len(rig.at_motor) == 3

    def test_dropped_by_chance_and_the_same_for_the_same_seed(self, rig: Rig) -> None:
        rig.faults.to_motor.drop(0.3)
        runs = []
        for seed in (1, 1, 2):
            rig.faults.seed(seed)
            runs.append([rig.answers() for _ in range(200)])
        assert runs[0] == runs[1] != runs[2]
        assert 110 < sum(runs[0]) < 170

    def test_late_on_the_way_to_the_motor(self, rig: Rig) -> None:
        rig.faults.to_motor.delay(0.05)
        sent_s = rig.clock.now_s
        rig.send()
        rig.wait(0.049)
        assert rig.received() == []
        assert rig.at_motor == []
        rig.wait(0.0015)
        assert len(rig.received()) == 1
        assert rig.at_motor[0][0] == pytest.approx(sent_s + 0.05 + FRAME_TIME_S)

    def test_late_on_the_way_from_the_motor(self, rig: Rig) -> None:
        rig.faults.from_motor.delay(0.05)
        rig.send()
        assert len(rig.at_motor) == 1
        rig.wait(0.05)
        assert rig.received() == []
        rig.wait(2 * FRAME_TIME_S)
        assert len(rig.received()) == 1

    def test_none_overtakes_another_when_the_delay_ends(self, rig: Rig) -> None:
        rig.faults.to_motor.delay(0.05)
        rig.send(command(q=1.0))
        rig.faults.to_motor.delay(0.0)
        rig.send(command(q=2.0))
        rig.wait(0.04)
        assert rig.received() == []
        rig.wait(0.02)
        assert len(rig.received()) == 2
        assert [frame for _, frame in rig.at_motor] == [command(q=1.0), command(q=2.0)]

    def test_out_of_order_when_asked(self, rig: Rig) -> None:
        rig.faults.to_motor.delay(0.05, in_order=False)
        sent = [command(q=number * 0.1) for number in range(20)]
        for frame in sent:
            rig.send(frame)
        rig.wait(0.06)
        assert len(rig.received()) == len(sent)
        came = [frame for _, frame in rig.at_motor]
        assert came != sent
        assert set(came) == set(sent)
        times = [at_s for at_s, _ in rig.at_motor]
        assert all(earlier <= later for earlier, later in pairwise(times))

    def test_late_frames_are_lost_with_the_link(self, rig: Rig) -> None:
        rig.faults.to_motor.delay(0.05)
        rig.send()
        rig.faults.link_down()
        rig.faults.link_up()
        rig.wait(0.1)
        assert code_of(lambda: rig.bus.recv(0)) == 100
        assert rig.received() == []
        assert rig.at_motor == []

    def test_doubled(self, rig: Rig) -> None:
        rig.faults.to_motor.double(1.0)
        assert rig.answers() == 2
        rig.faults.from_motor.double(1.0)
        assert rig.answers() == 4
        assert len(rig.at_motor) == 4

    def test_corrupted(self, rig: Rig) -> None:
        rig.faults.to_motor.corrupt(1.0)
        for _ in range(50):
            rig.answers(command())
        came = [frame for _, frame in rig.at_motor]
        assert len(came) == 50
        assert command() not in came
        assert all(frame.can_id == 0x08 and len(frame.data) == 8 for frame in came)
        assert len(set(came)) > 40

    def test_all_switched_off_at_once(self, rig: Rig) -> None:
        for direction in (rig.faults.to_motor, rig.faults.from_motor):
            direction.drop(1.0)
            direction.drop_next(9)
            direction.delay(1.0)
            direction.double(1.0)
            direction.corrupt(1.0)
            assert rig.answers() == 0
            direction.clear()
        assert rig.works()

    @pytest.mark.parametrize("bad", [-0.1, 1.1, float("nan")])
    @pytest.mark.parametrize("fault", [FrameFaults.drop, FrameFaults.double, FrameFaults.corrupt])
    def test_a_bad_probability_is_refused(
        self, rig: Rig, fault: Callable[[FrameFaults, float], None], bad: float
    ) -> None:
        with pytest.raises(ValueError, match="a probability must be 0 to 1"):
            fault(rig.faults.to_motor, bad)
        assert not rig.faults.to_motor.is_used

    def test_a_bad_delay_or_number_is_refused(self, rig: Rig) -> None:
        for bad_s in (-0.1, float("nan"), float("inf")):
            with pytest.raises(ValueError, match="the delay must be finite and not negative"):
                rig.faults.to_motor.delay(bad_s)
        with pytest.raises(ValueError, match="must not be negative"):
            rig.faults.to_motor.drop_next(-1)
        assert not rig.faults.to_motor.is_used


def test_any_thread_may_break_the_link_while_others_use_it() -> None:
    with SimulatedBus("torn") as bus:
        request = can.Message(arbitration_id=0x7FF, is_extended_id=False, data=STATUS.data)
        is_over = threading.Event()

        def use() -> None:  # whatever else is raised in a thread fails the test
            while not is_over.is_set():
                with (
                    contextlib.suppress(can.CanOperationError, OSError),
                    SimulatedBus("torn") as mine,
                ):
                    for _ in range(20):
                        mine.send(request)
                        mine.recv(0)

        threads = [threading.Thread(target=use) for _ in range(3)]
        for thread in threads:
            thread.start()
        faults = bus.faults
        for _ in range(100):
            for act in (
                faults.link_down,
                faults.stall,
                faults.link_up,
                faults.unplug,
                faults.unstall,
                faults.replug,
                faults.bus_off,
                faults.recover,
            ):
                act()
            faults.from_motor.delay(1e-4, in_order=False)
            faults.inject(STATUS)
        is_over.set()
        for thread in threads:
            thread.join(20.0)
        assert not any(thread.is_alive() for thread in threads)
        faults.from_motor.clear()
        with SimulatedBus("torn") as fresh:
            fresh.send(request)
            assert fresh.recv(5.0) is not None
