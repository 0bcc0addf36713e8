"""The python-can interface, mostly on a clock that the test turns by hand."""

import threading
import time
from collections.abc import Iterator
from typing import Any

import can
import pytest

from litegripd.model.gripper import DM4340
from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import FRAME_TIME_S, QUEUE_FRAMES, SimulatedBus
from tests.sim.driving import ENABLE, STATUS, command, decode
from tests.sim.faulty import Clock, drain, message


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def bus(clock: Clock) -> Iterator[SimulatedBus]:
    with SimulatedBus("sim0", monotonic_fn=clock) as opened:
        yield opened


def open_by_name(**options: Any) -> can.BusABC:
    return can.Bus(interface="litegrip_sim", ignore_config=True, **options)


def test_python_can_finds_the_interface_by_name() -> None:
    with can.Bus(interface="litegrip_sim", channel="sim0", ignore_config=True) as bus:
        assert str(bus) == "litegrip_sim: sim0"
        bus.send(message(STATUS))
        answer = bus.recv(1.0)
    assert answer is not None
    assert decode(CanFrame(answer.arbitration_id, bytes(answer.data))).status == 0
    assert answer.timestamp == pytest.approx(time.time(), abs=5.0)


def test_a_reply_takes_one_frame_time(bus: SimulatedBus, clock: Clock) -> None:
    bus.send(message(STATUS))
    assert bus.recv(0) is None
    clock.now_s += FRAME_TIME_S * 1.01
    answer = bus.recv(0)
    assert answer is not None
    assert answer.arbitration_id == 0x18
    assert answer.is_rx
    assert bus.recv(0) is None


def test_frames_sent_back_to_back_occupy_the_bus_one_after_the_other(
    bus: SimulatedBus, clock: Clock
) -> None:
    for _ in range(3):
        bus.send(message(STATUS))
    clock.now_s += FRAME_TIME_S * 2.01
    assert len(drain(bus)) == 2
    clock.now_s += FRAME_TIME_S
    assert len(drain(bus)) == 1


def test_time_moves_the_jaws(bus: SimulatedBus, clock: Clock) -> None:
    start_mm = bus.gripper.opening_mm
    bus.send(message(command(tau=1.0)))
    bus.send(message(ENABLE))
    clock.now_s += 0.05
    bus.send(message(STATUS))
    assert bus.gripper.opening_mm < start_mm - 10.0


def test_nodes_of_one_channel_see_each_other_and_share_the_gripper(
    bus: SimulatedBus, clock: Clock
) -> None:
    with SimulatedBus("sim0") as other, SimulatedBus("sim1", monotonic_fn=clock) as elsewhere:
        assert other.gripper is bus.gripper
        assert elsewhere.gripper is not bus.gripper
        bus.send(message(STATUS))
        clock.now_s += 0.001
        assert [found.arbitration_id for found in drain(bus)] == [0x18]
        assert [found.arbitration_id for found in drain(other)] == [0x7FF, 0x18]
        assert drain(elsewhere) == []


def test_own_messages_are_received_on_request(bus: SimulatedBus, clock: Clock) -> None:
    with SimulatedBus("sim0", receive_own_messages=True) as own:
        own.send(message(STATUS))
        clock.now_s += 0.001
        assert [(found.arbitration_id, found.is_rx) for found in drain(own)] == [
            (0x7FF, False),
            (0x18, True),
        ]


def test_extended_and_remote_frames_pass_the_motor_by(bus: SimulatedBus, clock: Clock) -> None:
    with SimulatedBus("sim0") as other:
        bus.send(can.Message(arbitration_id=0x08, is_extended_id=True, data=ENABLE.data))
        bus.send(
            can.Message(arbitration_id=0x08, is_extended_id=False, is_remote_frame=True, dlc=8)
        )
        clock.now_s += 0.001
        seen = drain(other)
    assert [(found.is_extended_id, found.is_remote_frame) for found in seen] == [
        (True, False),
        (False, True),
    ]
    assert drain(bus) == []
    assert bus.gripper.motor.status == 0


def test_filters_apply(bus: SimulatedBus, clock: Clock) -> None:
    bus.set_filters([{"can_id": 0x19, "can_mask": 0x7FF}])
    bus.send(message(STATUS))
    clock.now_s += 0.001
    assert bus.recv(0) is None


def test_receiving_waits_no_longer_than_asked(bus: SimulatedBus) -> None:
    start_s = time.monotonic()
    assert bus.recv(0.02) is None
    assert 0.015 < time.monotonic() - start_s < 1.0


def test_receiving_wakes_for_a_frame_of_another_node() -> None:
    with SimulatedBus("sim2") as reader, SimulatedBus("sim2") as writer:
        found: list[can.Message | None] = []
        thread = threading.Thread(target=lambda: found.append(reader.recv(5.0)))
        thread.start()
        writer.send(message(STATUS))
        thread.join(5.0)
        assert not thread.is_alive()
    assert found[0] is not None
    assert found[0].arbitration_id == 0x7FF


def test_shutting_down_ends_a_wait_and_later_use_with_a_clear_error() -> None:
    bus = SimulatedBus("sim2")
    errors: list[str] = []

    def wait() -> None:
        try:
            bus.recv(None)
        except can.CanOperationError as error:
            errors.append(str(error))

    thread = threading.Thread(target=wait)
    thread.start()
    bus.shutdown()
    bus.shutdown()
    thread.join(5.0)
    assert not thread.is_alive()
    assert errors == ["litegrip_sim: sim2 is shut down"]
    with pytest.raises(can.CanOperationError, match="is shut down"):
        bus.send(message(STATUS))
    with pytest.raises(can.CanOperationError, match="is shut down"):
        bus.recv(0)


def test_the_last_node_takes_a_built_gripper_along_but_not_a_given_one() -> None:
    mine = SimulatedGripper()
    for _ in range(2):
        with SimulatedBus("sim3", gripper=mine) as bus:
            assert bus.gripper is mine
    with SimulatedBus("sim3") as bus:
        assert bus.gripper is not mine


def test_options_build_the_gripper() -> None:
    with SimulatedBus(
        "sim3",
        mount="reverse",
        object_mm="30",
        object_stiffness_nm_rad=100,
        seed=3,
        bitrate=1_000_000,
    ) as bus:
        assert bus.gripper.parameters.close_sign == -1
        with SimulatedBus(
            "sim3", mount="reverse", object_mm=30.0, object_stiffness_nm_rad=100.0, seed="3"
        ) as same:
            assert same.gripper is bus.gripper
        with pytest.raises(ValueError, match="open already with other options"):
            SimulatedBus("sim3", mount="normal")


def test_it_has_the_type_of_motor_that_is_asked_for() -> None:
    with SimulatedBus("sim3", motor_type="DM4340") as bus:
        assert bus.gripper.parameters.motor_type is DM4340


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"widht": 3}, "unknown option widht"),
        ({"seed": "x"}, "seed must be a number"),
        ({"seed": 1.5}, "seed must be a whole number"),
        ({"seed": True}, "seed must be a number"),
        ({"object_mm": "wide"}, "object_mm must be a number"),
        ({"object_mm": -3}, "less than 87 mm wide"),
        ({"object_mm": float("nan")}, "less than 87 mm wide"),
        ({"object_mm": 3, "object_stiffness_nm_rad": 0}, "stiffness_nm_rad must be more than 0"),
        ({"object_stiffness_nm_rad": 5}, "needs object_mm"),
        ({"mount": "sideways"}, "mount must be one of"),
        (
            {"motor_type": "DM1"},
            "motor_type is 'DM1', no type of the family; it must be DM4310 or DM4340",
        ),
        ({"motor_type": "DM6006"}, "motor_type is 'DM6006', .*missing: ranges"),
        ({"bitrate": 500_000}, "bitrate must be 1000000"),
        ({"channel": ""}, "channel must be a name"),
        ({"gripper": SimulatedGripper(), "seed": 1}, "not both"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        open_by_name(**({"channel": "sim4"} | options))
    # Nothing is left behind.
    with SimulatedBus("sim4"):
        pass


def test_frames_that_are_not_classic_are_refused(bus: SimulatedBus) -> None:
    for bad in (can.Message(is_fd=True), can.Message(is_error_frame=True)):
        with pytest.raises(can.CanOperationError, match="classic data frames only"):
            bus.send(bad)


def test_a_node_that_never_reads_loses_the_newest_frames(bus: SimulatedBus, clock: Clock) -> None:
    with SimulatedBus("sim0") as idle:
        for _ in range(QUEUE_FRAMES):
            bus.send(message(STATUS))
        clock.now_s += 10.0
        assert len(drain(idle)) == QUEUE_FRAMES
        assert len(drain(bus)) == QUEUE_FRAMES


def test_many_threads_may_send_and_receive() -> None:
    with SimulatedBus("sim5") as shared:
        counts: list[int] = []

        def work() -> None:
            with SimulatedBus("sim5") as bus:
                for _ in range(50):
                    bus.send(message(STATUS))
                    bus.recv(0)
                counts.append(1)

        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20.0)
        assert counts == [1] * 4
        answers = 0
        while (found := shared.recv(1.0)) is not None and answers < 200:
            answers += found.arbitration_id == 0x18
            if answers == 200:
                break
        assert answers == 200


def test_the_watchdog_may_be_as_slow_as_motors_have_it() -> None:
    with can.Bus(
        interface="litegrip_sim", channel="slow", watchdog_s=0.4, ignore_config=True
    ) as bus:
        assert isinstance(bus, SimulatedBus)
        assert bus.gripper.motor.registers.timeout_s == pytest.approx(0.4)
