"""What a motor does unasked: it reports by itself, and disarms in a time of its own."""

from itertools import pairwise

import pytest

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import MotorWire, SimulatedBus
from litegripd.sim.plant import SimulatorParameters
from tests.sim.driving import DISABLE, ENABLE, STATUS, Driver, command, decode
from tests.sim.faulty import Clock, drain, message

TIMEOUT = 9


def driver(**figures: float) -> Driver:
    return Driver(SimulatedGripper(SimulatorParameters(**figures)))  # type: ignore[arg-type]


def test_it_reports_by_itself_only_while_it_is_enabled() -> None:
    motor = driver(unasked_hz=10.0, comm_loss_s=0.0)
    motor.wait(1.0)
    assert motor.gripper.take_unasked(motor.now_s) == []
    motor.arm()
    motor.wait(1.01)
    reports = motor.gripper.take_unasked(motor.now_s)
    assert [round(later - earlier, 6) for (earlier, _), (later, _) in pairwise(reports)] == [
        0.1
    ] * 9
    assert {decode(frame).status for _, frame in reports} == {1}
    assert motor.gripper.take_unasked(motor.now_s) == []
    motor.ask(DISABLE)
    motor.wait(1.0)
    assert motor.gripper.take_unasked(motor.now_s) == []


def test_without_a_rate_it_only_answers() -> None:
    motor = driver(comm_loss_s=0.0)
    motor.arm()
    motor.wait(5.0)
    assert motor.gripper.take_unasked(motor.now_s) == []
    assert motor.gripper.next_unasked_s == float("inf")


@pytest.mark.parametrize("reads_s", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("loss_s", [0.1, 0.4, 0.9])
def test_it_disarms_in_its_own_time_whatever_the_register_says(
    loss_s: float, reads_s: float
) -> None:
    motor = driver(watchdog_s=reads_s, comm_loss_s=loss_s)
    assert motor.read_int(TIMEOUT) == round(reads_s / 50e-6)
    motor.arm()
    motor.write(TIMEOUT, 4000)
    assert motor.read_int(TIMEOUT) == 4000
    motor.stream(0.1, command())
    motor.wait(loss_s - 0.01)
    assert motor.ask(STATUS).status == 1
    motor.wait(0.02)
    assert motor.ask(STATUS).status == 0xD


def test_that_can_change_while_it_runs() -> None:
    motor = driver()
    motor.gripper.set_comm_loss(0.9)
    motor.gripper.set_unasked(100.0)
    motor.arm()
    motor.wait(0.5)
    assert len(motor.gripper.take_unasked(motor.now_s)) == 50
    motor.gripper.set_comm_loss(None)
    motor.ask(command())
    motor.wait(0.2)
    assert motor.ask(STATUS).status == 0xD
    assert len(motor.gripper.take_unasked(motor.now_s)) == 9  # the tenth would come as it disarms


def test_reports_come_to_every_node_of_the_bus_and_may_get_lost() -> None:
    clock = Clock()
    with SimulatedBus("own", unasked_hz=10.0, comm_loss_s="0", monotonic_fn=clock) as bus:
        for frame in (command(), ENABLE):
            bus.send(message(frame))
        clock.now_s += 0.05
        assert len(drain(bus)) == 2
        with SimulatedBus("own", monotonic_fn=clock) as other:
            clock.now_s += 0.5
            assert len(drain(bus)) == len(drain(other)) == 5
        clock.now_s += 0.1
        assert bus.recv(0) is not None


def test_reports_suffer_the_faults_of_the_wire() -> None:
    wire = MotorWire(SimulatedGripper(SimulatorParameters(unasked_hz=10.0, comm_loss_s=0.0)))
    wire.gripper.advance(0.0)
    for frame in (command(), ENABLE):
        wire.carry(0.0, 0.0, frame)
    assert wire.next_s == pytest.approx(0.1)
    assert [at_s for at_s, _ in wire.late(0.25)] == pytest.approx([0.1, 0.2])
    wire.from_motor.delay(0.03)
    assert wire.late(0.31) == []
    assert wire.next_s == pytest.approx(0.33)
    assert len(wire.late(0.34)) == 1
    wire.from_motor.drop(1.0)
    assert wire.late(5.0) == []


def test_a_disabled_motor_without_commands_latches_a_loss_where_that_is_wanted() -> None:
    gripper = SimulatedGripper(SimulatorParameters(idle_loss_s=0.9))
    motor = gripper.motor
    gripper.advance(0.0)
    gripper.advance(0.85)
    gripper.receive(0.85, CanFrame(0x7FF, bytes([8, 0, 0xCC, 0])))  # which is no command
    assert motor.status == 0x0
    gripper.advance(0.95)
    assert motor.status == 0xD
    gripper.receive(1.0, CanFrame(8, bytes.fromhex("FFFFFFFFFFFFFFFB")))
    assert motor.status == 0x0
    gripper.advance(1.85)
    gripper.receive(1.85, CanFrame(8, DISABLE.data))
    gripper.advance(2.7)
    assert motor.status == 0x0
    gripper.advance(2.8)
    assert motor.status == 0xD
    gripper.power_cycle()
    assert motor.status == 0x0
    gripper.advance(5.0)
    assert motor.status == 0xD


def test_a_disabled_motor_latches_nothing_unless_it_is_told_to() -> None:
    gripper = SimulatedGripper()
    gripper.advance(0.0)
    gripper.advance(60.0)
    assert gripper.motor.status == 0x0
    gripper.set_idle_loss(0.5)
    gripper.advance(61.0)
    assert gripper.motor.status == 0xD


def test_bad_figures_are_refused() -> None:
    for bad in (
        {"unasked_hz": 1001.0},
        {"unasked_hz": -1.0},
        {"comm_loss_s": -0.1},
        {"idle_loss_s": -0.1},
    ):
        with pytest.raises(ValueError, match=next(iter(bad))):
            driver(**bad)
    gripper = SimulatedGripper()
    for rate_hz in (-1.0, 1001.0, float("nan")):
        with pytest.raises(ValueError, match="0 to 1000 Hz"):
            gripper.set_unasked(rate_hz)
    for seconds in (-1.0, float("inf")):
        with pytest.raises(ValueError, match="finite and not negative"):
            gripper.set_comm_loss(seconds)
        with pytest.raises(ValueError, match="finite and not negative"):
            gripper.set_idle_loss(seconds)
    assert gripper.receive(0.0, CanFrame(8, DISABLE.data))
