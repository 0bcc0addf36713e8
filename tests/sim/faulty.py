"""A bus object on a clock that a test turns, with what came to its motor."""

from collections.abc import Callable

import can
import pytest

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import SimulatedBus
from tests.sim.driving import STATUS

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
        (bus or self.bus).send(message(frame))

    def wait(self, duration_s: float = A_WHILE_S) -> None:
        self.clock.now_s += duration_s

    def received(self, bus: SimulatedBus | None = None) -> list[can.Message]:
        return drain(bus or self.bus)

    def answers(self, frame: CanFrame = STATUS) -> int:
        """Send a frame; return how many answers have come after a while."""
        self.send(frame)
        self.wait()
        return len(self.received())

    def works(self) -> bool:
        return self.answers() == 1


def message(frame: CanFrame) -> can.Message:
    return can.Message(arbitration_id=frame.can_id, is_extended_id=False, data=frame.data)


def drain(bus: can.BusABC) -> list[can.Message]:
    """Take all that has come."""
    found = []
    while (one := bus.recv(0)) is not None:
        found.append(one)
    return found


def code_of(act: Callable[[], object]) -> int | None:
    """Return the code of the error that python-can raises; it is no `OSError`."""
    with pytest.raises(can.CanOperationError) as raised:
        act()
    assert not isinstance(raised.value, OSError)
    return raised.value.error_code
