import math
import struct

import pytest

from litegripd.model.gripper import MOTOR_TYPES, MotorType
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from litegripd.sim.registers import TABLE
from tests.sim.driving import ENABLE, SAVE, STATUS, Driver, command, read

READ_ONLY = {*range(11, 21), 36, *range(50, 57), *range(59, 66), 80, 81}
NUMBERS = {*range(37), *range(50, 57), *range(59, 66), 80, 81}
INTEGERS = {7, 8, 9, 10, 13, 14, 15, 16, 35, 36}

FIRST_VALUES: dict[int, float] = {
    0: 15.0,
    2: 100.0,
    7: 0x18,
    8: 0x08,
    9: 2000,
    10: 1,
    20: 10.0,
    21: 12.5,
    22: 30.0,
    23: 10.0,
    35: 4,
}


@pytest.mark.parametrize(("rid", "value"), FIRST_VALUES.items())
def test_first_values(rid: int, value: float) -> None:
    driver = Driver()
    found = driver.read_float(rid) if isinstance(value, float) else driver.read_int(rid)
    assert found == value


@pytest.mark.parametrize("motor_type", MOTOR_TYPES.values(), ids=MOTOR_TYPES)
def test_a_motor_tells_its_type(motor_type: MotorType) -> None:
    driver = Driver(SimulatedGripper(SimulatorParameters().of_motor(motor_type)))
    spans = motor_type.ranges
    assert [driver.read_float(rid) for rid in (20, 21, 22, 23)] == [
        motor_type.gear_ratio,
        spans.position_rad,
        spans.velocity_rad_s,
        spans.torque_nm,
    ]


@pytest.mark.parametrize("rid", [0, 2, 3, 7, 8, 9, 10, 13, 14, 15, 20, 21, 22, 23, 35])
def test_every_documented_register_answers(rid: int) -> None:
    assert any(Driver().read(rid))


@pytest.mark.parametrize("rid", sorted(NUMBERS))
def test_every_register_of_the_family_answers_with_a_number(rid: int) -> None:
    driver = Driver()
    assert TABLE[rid].is_float is (rid not in INTEGERS)
    value = driver.read_float(rid) if TABLE[rid].is_float else driver.read_int(rid)
    assert math.isfinite(value)
    assert value == pytest.approx(driver.gripper.motor.registers[rid], rel=1e-6)
    if TABLE[rid].writable:
        assert TABLE[rid].low <= value <= TABLE[rid].high


def test_there_are_no_others() -> None:
    driver = Driver()
    for rid in set(range(256)) - NUMBERS:
        assert driver.gripper.receive(0.0, read(rid)) == []


def test_what_is_measured_is_as_it_is_now() -> None:
    driver = Driver(SimulatedGripper(SimulatorParameters(watchdog_s=10.0)))
    driver.gripper.set_supply(22.5)
    assert driver.read_float(60) == 22.5
    driver.gripper.heat_coil(70.0)
    assert driver.read_float(62) == pytest.approx(70.0)
    assert driver.read_float(61) == pytest.approx(25.0)
    for _ in range(2):
        position_rad = driver.ask(STATUS).position_rad
        for rid in (80, 81):
            assert driver.read_float(rid) == pytest.approx(position_rad, abs=4e-4)
        driver.gripper.jump(0.3)


def test_a_write_is_echoed_and_unsaved_it_is_lost_with_the_power() -> None:
    driver = Driver()
    assert driver.write(9, 8000) == struct.pack("<I", 8000)
    assert driver.read_int(9) == 8000
    driver.gripper.power_cycle()
    assert driver.read_int(9) == 2000


def test_a_saved_write_outlives_the_power() -> None:
    driver = Driver()
    driver.write(9, 8000)
    (answer,) = driver.gripper.receive(0.0, SAVE)
    assert answer.data == bytes([8, 0, 0xAA, 1, 0, 0, 0, 0])
    driver.write(9, 1)
    driver.gripper.power_cycle()
    assert driver.read_int(9) == 8000


def test_saving_is_refused_while_enabled() -> None:
    driver = Driver()
    driver.write(9, 8000)
    driver.arm()
    assert driver.gripper.receive(0.0, SAVE) == []
    driver.gripper.power_cycle()
    assert driver.read_int(9) == 2000


@pytest.mark.parametrize("rid", sorted(READ_ONLY))
def test_read_only_registers_answer_a_write_with_what_they_hold(rid: int) -> None:
    driver = Driver()
    before = driver.read(rid)
    assert driver.write(rid, 77) == before
    assert driver.read(rid) == before


@pytest.mark.parametrize(
    ("rid", "value"), [(21, math.nan), (21, -1.0), (21, math.inf), (10, 5), (10, 0), (7, 0x800)]
)
def test_a_value_out_of_range_is_refused(rid: int, value: float) -> None:
    driver = Driver()
    before = driver.read(rid)
    assert driver.write(rid, value) == before


def test_a_write_answer_decodes_as_a_feedback_frame_far_from_here() -> None:
    driver = Driver()
    feedback = driver.ask(read(9))
    assert feedback.position_rad == pytest.approx(-12.5, abs=0.05)


def test_changed_ranges_scale_the_feedback() -> None:
    driver = Driver()
    true_rad = driver.gripper.position_rad
    driver.write(21, 25.0)
    assert driver.ask(STATUS).position_rad == pytest.approx(true_rad / 2, abs=4e-4)


def test_changed_ids_are_used_at_once() -> None:
    driver = Driver()
    driver.write(8, 0x09)
    assert driver.gripper.receive(0.0, command()) == []
    assert driver.gripper.receive(0.0, ENABLE) == []
    driver = Driver()
    (answer,) = driver.gripper.receive(0.0, read(7))
    assert answer.can_id == 0x18
    driver.gripper.motor.registers.write(7, struct.pack("<I", 0))
    (answer,) = driver.gripper.receive(0.0, STATUS)
    assert answer.can_id == 0
