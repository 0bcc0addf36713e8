"""What a bus object raises, receives and loses for each fault of the link, and what recovers."""

import contextlib
import errno
import threading

import can
import pytest

from litegripd.model.motor import CanFrame
from litegripd.sim.faults import BUS_OFF_ID, TX_QUEUE_FRAMES
from litegripd.sim.interface import SimulatedBus
from tests.sim.driving import ENABLE, STATUS, command, decode
from tests.sim.faulty import Rig, code_of, message


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


def test_any_thread_may_break_the_link_while_others_use_it() -> None:
    with SimulatedBus("torn") as bus:
        request = message(STATUS)
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
