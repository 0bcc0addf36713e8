"""The interfaces that are read in the control thread, as python-can has them."""

import time
from collections.abc import Iterator

import can
import pytest

from litegripd.io.can.bus import DirectBus
from litegripd.model.motor import BusSettings, CanFrame
from litegripd.motor.codec import status_request

FRAME = CanFrame(0x08, bytes(range(8)))
MESSAGE = can.Message(arbitration_id=0x18, data=bytes(8), is_extended_id=False)


def receive(bus: DirectBus) -> list[CanFrame]:
    """Return what comes first."""
    ends_s = time.monotonic() + 20.0
    while time.monotonic() < ends_s:
        if frames := bus.receive(0.0):
            return frames
    raise AssertionError("nothing came in time")


@pytest.fixture
def simulated() -> Iterator[DirectBus]:
    bus = DirectBus(BusSettings("litegrip_sim", "test_direct_bus", 1_000_000))
    yield bus
    bus.close()


def test_the_simulated_motor_answers(simulated: DirectBus) -> None:
    simulated.receive(0.0)
    assert simulated.condition.is_usable
    simulated.send((status_request(0x08),), 0.0)
    got = receive(simulated)
    assert got[0].can_id == 0x18
    assert got[0].data[0] == 0x08


def test_a_wrong_option_is_named() -> None:
    bus = DirectBus(BusSettings("litegrip_sim", "x", 1_000_000, {"colour": "red"}))
    bus.receive(0.0)
    assert bus.condition.error is not None
    assert "colour" in bus.condition.error


def test_the_virtual_interface_can_be_read_without_waiting() -> None:
    ours = DirectBus(BusSettings("virtual", "test_direct_bus", 1_000_000))
    ours.receive(0.0)
    with can.Bus("test_direct_bus", interface="virtual", ignore_config=True) as other:
        other.send(MESSAGE)
        other.send(can.Message(arbitration_id=0x18, is_extended_id=True))
        assert receive(ours) == [CanFrame(0x18, bytes(8))]
        ours.send((FRAME,), 0.0)
        echoed = other.recv(20.0)
        assert echoed is not None
        assert bytes(echoed.data) == FRAME.data
    ours.close()
    assert ours.counters.ignored == 1
