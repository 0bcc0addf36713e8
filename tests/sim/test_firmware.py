"""What the motor's firmware does with frames, and what surprises the drivers that send them."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from tests.sim.driving import (
    CLEAR,
    DISABLE,
    ENABLE,
    STATUS,
    ZERO,
    Driver,
    command,
    decode,
    read,
    special,
)

LOST, DISABLED, ENABLED = 0xD, 0, 1


def test_it_answers_each_frame_once_and_is_silent_otherwise() -> None:
    driver = Driver()
    driver.wait(1.0)
    for frame in (command(), ENABLE, command(kp=10.0), ZERO, DISABLE, CLEAR, STATUS, read(9)):
        assert len(driver.gripper.receive(driver.now_s, frame)) == 1


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x07, command().data),
        CanFrame(0x18, command().data),
        CanFrame(0x108, bytes(8)),
        CanFrame(0x08, command().data[:7]),
        CanFrame(0x08, b""),
        CanFrame(0x7FF, bytes([9, 0, 0xCC, 0, 0, 0, 0, 0])),
        CanFrame(0x7FF, bytes([8, 1, 0x33, 9, 0, 0, 0, 0])),
        CanFrame(0x7FF, bytes([8, 0, 0x33])),
        CanFrame(0x7FF, bytes([8, 0, 0x77, 9, 0, 0, 0, 0])),
        CanFrame(0x7FF, bytes([8, 0, 0x33, 200, 0, 0, 0, 0])),
    ],
)
def test_it_ignores_what_is_not_for_it(frame: CanFrame) -> None:
    assert Driver().gripper.receive(0.0, frame) == []


def test_feedback_tells_state_position_and_temperatures() -> None:
    driver = Driver()
    feedback = driver.ask(STATUS)
    assert (feedback.motor_id, feedback.status) == (8, DISABLED)
    assert feedback.position_rad == pytest.approx(driver.gripper.position_rad, abs=4e-4)
    assert feedback.velocity_rad_s == pytest.approx(0.0, abs=0.015)
    assert (feedback.driver_c, feedback.coil_c) == (25, 25)
    assert driver.arm().status == ENABLED
    assert driver.ask(DISABLE).status == DISABLED


def test_a_command_that_arrives_while_disabled_is_applied_by_enable() -> None:
    driver = Driver()
    start_rad = driver.gripper.position_rad
    driver.ask(command(q=start_rad + 0.1, kp=100.0, kd=2.0))
    driver.wait(0.5)
    assert driver.gripper.position_rad == start_rad
    driver.ask(ENABLE)
    driver.wait(0.09)
    assert driver.gripper.position_rad == pytest.approx(start_rad + 0.1, abs=0.02)


def test_enabling_again_repeats_the_last_command() -> None:
    driver = Driver()
    target_rad = driver.gripper.position_rad - 0.1
    driver.arm()
    driver.stream(0.5, command(q=target_rad, kp=100.0, kd=2.0))
    driver.ask(DISABLE)
    driver.gripper.push(2.0)
    driver.wait(0.1)
    driver.gripper.push(0.0)
    driver.wait(0.5)
    moved_rad = driver.gripper.position_rad
    assert moved_rad > target_rad + 0.05
    driver.ask(ENABLE)
    driver.wait(0.09)
    assert driver.gripper.position_rad < moved_rad - 0.05


def test_the_watchdog_trips_100_ms_after_the_last_command_and_disarms() -> None:
    driver = Driver()
    driver.arm()
    driver.stream(0.2, command(q=driver.gripper.position_rad, kp=50.0, kd=1.0))
    driver.wait(0.0945)  # the last command was one period of 5 ms ago
    assert driver.ask(STATUS).status == ENABLED
    driver.wait(0.001)
    assert driver.ask(STATUS).status == LOST
    assert not driver.gripper.motor_torque_nm


def test_only_frames_to_its_own_id_feed_the_watchdog() -> None:
    driver = Driver()
    driver.arm()
    for _ in range(30):
        driver.ask(STATUS)
        driver.gripper.receive(driver.now_s, read(9))
        driver.gripper.receive(driver.now_s, CanFrame(0x09, command().data))
        driver.wait(0.005)
    assert driver.ask(STATUS).status == LOST


def test_the_watchdog_does_not_run_while_disabled_nor_when_switched_off() -> None:
    driver = Driver()
    driver.ask(command())
    driver.wait(10.0)
    assert driver.ask(STATUS).status == DISABLED
    driver.write(9, 0)
    driver.arm()
    driver.wait(10.0)
    assert driver.ask(STATUS).status == ENABLED


def test_a_shorter_timeout_counts_from_the_next_command() -> None:
    driver = Driver()
    driver.write(9, 400)  # 20 ms
    driver.arm()
    driver.wait(0.019)
    assert driver.ask(STATUS).status == ENABLED
    driver.wait(0.002)
    assert driver.ask(STATUS).status == LOST


def test_a_fault_stays_until_it_is_cleared_and_clearing_disarms() -> None:
    driver = Driver()
    driver.arm()
    driver.wait(0.2)
    assert driver.ask(ENABLE).status == LOST
    assert driver.ask(DISABLE).status == LOST
    assert driver.ask(command()).status == LOST
    assert driver.ask(CLEAR).status == DISABLED
    assert driver.ask(ENABLE).status == ENABLED
    assert driver.ask(CLEAR).status == DISABLED


def test_zero_is_taken_while_disabled_and_ignored_while_enabled() -> None:
    driver = Driver()
    before_rad = driver.ask(STATUS).position_rad
    driver.arm()
    assert driver.ask(ZERO).position_rad == before_rad
    driver.ask(DISABLE)
    assert driver.ask(ZERO).position_rad == pytest.approx(0.0, abs=4e-4)
    # Commands count from the new zero: holding 0 holds the jaws where they are.
    mechanical_rad = driver.gripper.position_rad
    driver.arm()
    driver.stream(0.3, command(q=0.0, kp=100.0, kd=2.0))
    assert driver.gripper.position_rad == pytest.approx(mechanical_rad, abs=0.003)
    driver.gripper.power_cycle()
    assert driver.ask(STATUS).position_rad == pytest.approx(0.0, abs=0.003)


def test_in_another_control_mode_mit_commands_are_not_taken() -> None:
    driver = Driver()
    driver.write(10, 2)
    assert driver.gripper.receive(0.0, command(kp=10.0)) == []
    assert driver.ask(ENABLE).status == ENABLED


def test_the_position_wraps_beyond_the_range_and_a_power_cycle_forgets_the_turns() -> None:
    opening_mm = 27.0 * SimulatorParameters().rad_to_mm
    travel = SimulatorParameters(closed_rad=40.0, open_rad=0.0, initial_opening_mm=opening_mm)
    driver = Driver(SimulatedGripper(travel))
    mechanical_rad = driver.gripper.position_rad
    assert mechanical_rad == pytest.approx(13.0)
    wrapped_rad = 13.0 - 25.0
    assert driver.ask(STATUS).position_rad == pytest.approx(wrapped_rad, abs=0.01)
    driver.gripper.power_cycle()
    within_rad = 13.0 - 2 * math.tau
    assert driver.ask(STATUS).position_rad == pytest.approx(within_rad, abs=4e-4)
    driver.gripper.power_cycle(turns=1)
    assert driver.ask(STATUS).position_rad == pytest.approx(within_rad + math.tau, abs=4e-4)
    assert driver.gripper.position_rad == mechanical_rad


def test_a_power_cycle_forgets_faults_arming_and_the_stored_command() -> None:
    driver = Driver()
    start_rad = driver.gripper.position_rad
    driver.ask(command(q=start_rad + 0.1, kp=100.0, kd=2.0))
    driver.gripper.power_cycle()
    driver.ask(ENABLE)
    driver.wait(0.09)
    assert driver.gripper.position_rad == start_rad
    driver.wait(0.2)
    assert driver.ask(STATUS).status == LOST
    driver.gripper.power_cycle()
    assert driver.ask(STATUS).status == DISABLED


@pytest.mark.parametrize(("volts", "fault"), [(0.0, 9), (14.9, 9), (32.1, 8)])
def test_a_wrong_supply_latches_while_the_motor_goes_on_answering(volts: float, fault: int) -> None:
    driver = Driver()
    driver.arm()
    driver.gripper.set_supply(volts)
    assert driver.ask(STATUS).status == fault
    assert driver.ask(CLEAR).status == fault
    driver.gripper.set_supply(24.0)
    assert driver.ask(ENABLE).status == fault
    assert driver.ask(CLEAR).status == DISABLED
    assert driver.ask(ENABLE).status == ENABLED


def press(driver: Driver, torque_nm: float, most_s: float) -> float:
    """Press against the open end until the motor trips; return after how long it did."""
    driver.arm()
    start_s = driver.now_s
    while driver.now_s - start_s < most_s:
        if driver.stream(0.05, command(kd=1.0, tau=torque_nm)).status != ENABLED:
            return driver.now_s - start_s
    return math.inf


def test_full_torque_heats_the_coil_until_it_trips() -> None:
    driver = Driver()
    tripped_s = press(driver, -9.0, 30.0)
    # 1.5 · 0.85 Ω · (9.52 A)² = 116 W on 2.8 K/W with 60 s (and 1.5 K/W with 750 s): 75 K in 15 s.
    assert 13.0 < tripped_s < 18.0
    feedback = driver.ask(STATUS)
    assert feedback.status == 0xC
    assert feedback.coil_c == 100
    assert driver.ask(CLEAR).status in (DISABLED, 0xC)
    driver.wait(30.0)
    driver.ask(CLEAR)
    cooled = driver.ask(STATUS)
    assert cooled.status == DISABLED
    assert cooled.coil_c < 80


def test_the_rated_torque_can_be_held() -> None:
    driver = Driver()
    assert press(driver, -3.0, 120.0) == math.inf
    # 12.9 W: 2.8 K/W at 1 - exp(-120/60) and 1.5 K/W at 1 - exp(-120/750), above 25 °C.
    assert driver.ask(STATUS).coil_c == pytest.approx(59, abs=2)


def test_a_hot_driver_trips_too() -> None:
    weak = replace(SimulatorParameters(), driver_k_w=3.0, winding_k_w=0.5)
    driver = Driver(SimulatedGripper(weak))
    assert press(driver, -9.0, 60.0) < 60.0
    assert driver.ask(STATUS).status == 0xB


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0x08, 0x7FF, 0x18, 0x00]),
            st.one_of(
                st.binary(max_size=8),
                st.binary(max_size=6).map(lambda rest: (b"\x08\x00" + rest)[:8]),
                st.sampled_from([special(code).data for code in range(0xFA, 0x100)]),
            ),
        ),
        max_size=30,
    )
)
@settings(max_examples=150)
def test_no_frame_ever_raises_and_every_answer_is_well_formed(
    frames: list[tuple[int, bytes]],
) -> None:
    driver = Driver()
    for can_id, data in frames:
        for answer in driver.gripper.receive(driver.now_s, CanFrame(can_id, data)):
            assert len(answer.data) == 8
            assert 0 <= answer.can_id <= 0x7FF
        driver.wait(0.002)
    assert math.isfinite(driver.gripper.position_rad)


@pytest.mark.parametrize("now_s", [math.nan, math.inf, -math.inf])
def test_a_time_that_is_not_finite_is_refused(now_s: float) -> None:
    with pytest.raises(ValueError, match="now_s must be a finite time"):
        Driver().gripper.advance(now_s)


def test_a_time_in_the_past_changes_nothing() -> None:
    driver = Driver()
    driver.gripper.push(1.0)
    driver.wait(0.05)
    position_rad = driver.gripper.position_rad
    driver.gripper.advance(0.01)
    assert driver.gripper.position_rad == position_rad
    (answer,) = driver.gripper.receive(0.01, STATUS)
    assert decode(answer).status == DISABLED
