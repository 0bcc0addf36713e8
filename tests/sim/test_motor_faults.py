"""What a motor that is broken, blocked, hot or without power does."""

import math

import pytest

from litegripd.sim import registers as reg
from litegripd.sim.motor import FAULTS
from tests.sim.driving import CLEAR, DISABLE, ENABLE, STATUS, Driver, command, read


@pytest.mark.parametrize("status", FAULTS)
def test_a_latched_fault_disarms_until_it_is_cleared(status: int) -> None:
    driver = Driver()
    driver.arm()
    driver.stream(0.05, command(tau=0.5))
    driver.gripper.latch_fault(status)
    assert driver.ask(STATUS).status == status
    assert not driver.gripper.motor_torque_nm
    assert driver.ask(ENABLE).status == status
    assert driver.ask(DISABLE).status == status
    assert driver.ask(CLEAR).status == 0
    assert driver.arm().status == 1


@pytest.mark.parametrize("status", [0, 1, 7, 0xF])
def test_no_other_status_can_be_latched(status: int) -> None:
    with pytest.raises(ValueError, match="0x8 to 0xE"):
        Driver().gripper.latch_fault(status)


@pytest.mark.parametrize("share", [-0.1, 1.5, math.nan])
def test_no_other_share_of_a_torque_can_be_made(share: float) -> None:
    driver = Driver()
    with pytest.raises(ValueError, match="made_share must be 0 to 1"):
        driver.gripper.weaken(share)
    assert driver.gripper.made_share == 1.0


@pytest.mark.parametrize("torque_nm", [3.0, -3.0])
@pytest.mark.parametrize("where_mm", [60.0, 1.0, 118.0])
def test_a_stuck_rotor_stands_whatever_its_torque(where_mm: float, torque_nm: float) -> None:
    driver = Driver()
    parameters = driver.gripper.parameters
    target_rad = parameters.closed_rad - where_mm / parameters.rad_to_mm
    driver.arm()
    driver.stream(1.0, command(q=target_rad, kp=100.0, kd=2.0))
    driver.gripper.jam()
    stuck_rad = driver.gripper.position_rad
    feedback = driver.stream(0.5, command(tau=torque_nm))
    assert driver.gripper.position_rad == stuck_rad
    assert feedback.torque_nm == pytest.approx(torque_nm, abs=0.02)
    assert driver.gripper.motor.coil_c > 25.05
    driver.gripper.push(20.0)
    driver.stream(0.1, command())
    assert driver.gripper.position_rad == stuck_rad
    driver.gripper.push(0.0)
    driver.gripper.free()
    driver.stream(0.5, command(q=-0.7, kp=50.0, kd=2.0))
    assert driver.gripper.position_rad == pytest.approx(-0.7, abs=0.02)


def test_moving_jaws_are_stuck_at_once_and_on_an_object_too() -> None:
    driver = Driver()
    driver.gripper.put_object(width_mm=40.0, yield_mm_s=3.0)
    driver.arm()
    driver.stream(0.5, command(kd=3.0, dq=1.0, tau=0.5))
    driver.gripper.jam()
    stuck_rad = driver.gripper.position_rad
    driver.stream(0.2, command(tau=3.0))
    assert (driver.gripper.position_rad, driver.gripper.velocity_rad_s) == (stuck_rad, 0.0)
    driver.gripper.free()
    driver.stream(0.2, command(tau=3.0))
    assert driver.gripper.position_rad > stuck_rad


def test_a_jump_of_the_encoder_moves_the_report_and_then_the_jaws() -> None:
    driver = Driver()
    start_rad = driver.ask(STATUS).position_rad
    driver.gripper.jump(0.2)
    assert driver.ask(STATUS).position_rad == pytest.approx(start_rad + 0.2, abs=5e-4)
    assert driver.gripper.position_rad == pytest.approx(start_rad, abs=5e-4)
    driver.arm()
    hold = command(q=start_rad + 0.2, kp=100.0, kd=2.0)
    driver.stream(0.2, hold)
    driver.gripper.jump(0.2)
    driver.wait(0.05)  # the motor's own loop follows, without another command
    assert driver.gripper.position_rad < start_rad - 0.1
    driver.stream(0.5, hold)
    assert driver.gripper.position_rad == pytest.approx(start_rad - 0.2, abs=0.02)
    with pytest.raises(ValueError, match="angle_rad must be finite"):
        driver.gripper.jump(math.nan)


def test_a_motor_without_power_is_silent_slack_and_forgets_what_was_not_saved() -> None:
    driver = Driver()
    driver.write(9, 4000)
    driver.arm()
    driver.stream(0.1, command(tau=0.3))
    driver.gripper.power_off()
    assert not driver.gripper.motor.is_powered
    for frame in (STATUS, command(tau=1.0), ENABLE, CLEAR, read(9)):
        assert driver.gripper.receive(driver.now_s, frame) == []
    driver.gripper.set_supply(0.0)
    driver.gripper.set_supply(24.0)
    with pytest.raises(ValueError, match="switched off"):
        driver.gripper.latch_fault(0xB)
    driver.wait(0.2)
    assert driver.gripper.motor_torque_nm == pytest.approx(0.0, abs=1e-6)
    start_rad = driver.gripper.position_rad
    driver.gripper.push(-0.3)
    driver.wait(0.2)
    slack_rad = start_rad - driver.gripper.position_rad
    driver.gripper.push(0.0)
    driver.gripper.power_on()
    feedback = driver.ask(STATUS)
    assert feedback.status == 0
    assert feedback.position_rad == pytest.approx(driver.gripper.position_rad, abs=5e-4)
    assert driver.read_int(reg.TIMEOUT) == 2000
    driver.wait(0.5)
    start_rad = driver.gripper.position_rad
    driver.gripper.push(0.3)  # disabled, the shorted phases brake
    driver.wait(0.2)
    assert driver.gripper.position_rad - start_rad < slack_rad / 2


def test_switched_on_again_it_may_be_off_by_a_turn() -> None:
    driver = Driver()
    before_rad = driver.ask(STATUS).position_rad
    driver.gripper.power_off()
    driver.wait(1.0)
    driver.gripper.power_on(turns=1)
    assert driver.ask(STATUS).position_rad == pytest.approx(before_rad + math.tau, abs=5e-4)


def test_a_hot_coil_trips_at_its_limit_and_cools() -> None:
    driver = Driver()
    driver.arm()
    driver.gripper.heat_coil(99.0)
    feedback = driver.ask(command())
    assert (feedback.status, feedback.coil_c) == (1, 99)
    driver.gripper.heat_coil(101.0)
    assert driver.ask(STATUS).status == 0xC
    assert driver.ask(CLEAR).status == 0xC  # as hot as before
    driver.wait(20.0)
    cooled = driver.ask(CLEAR)
    assert cooled.status == 0
    assert 60 < cooled.coil_c < 90
    for bad_c in (-51.0, 301.0, math.nan):
        with pytest.raises(ValueError, match="-50 to 300"):
            driver.gripper.heat_coil(bad_c)
