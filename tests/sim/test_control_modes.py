"""The control modes 2 to 4: their frames, their ids, and what the motor then does."""

import math
import struct
from collections.abc import Callable

import pytest

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper, build_gripper
from tests.sim.driving import (
    CAN_ID,
    CLEAR,
    DISABLE,
    ENABLE,
    PERIOD_S,
    STATUS,
    ZERO,
    Driver,
    command,
    decode,
)

CTRL_MODE, ACC, MAX_SPD, KP_ASR, KP_APR = 10, 4, 6, 25, 27
LOST, DISABLED, ENABLED = 0xD, 0, 1


def position_frame(position_rad: float, speed_rad_s: float) -> CanFrame:
    return CanFrame(0x100 + CAN_ID, struct.pack("<ff", position_rad, speed_rad_s))


def velocity_frame(speed_rad_s: float) -> CanFrame:
    return CanFrame(0x200 + CAN_ID, struct.pack("<f", speed_rad_s))


def force_frame(position_rad: float, speed_rad_s: float, share: float) -> CanFrame:
    data = struct.pack("<fHH", position_rad, round(speed_rad_s * 100), round(share * 10000))
    return CanFrame(0x300 + CAN_ID, data)


def in_mode(mode: int, gripper: SimulatedGripper | None = None) -> Driver:
    driver = Driver(gripper)
    driver.write(CTRL_MODE, mode)
    driver.ask(ENABLE)
    return driver


HARMLESS: dict[int, Callable[[float], CanFrame]] = {
    1: lambda _: command(),
    2: lambda position_rad: position_frame(position_rad, 1.0),
    3: lambda _: velocity_frame(0.0),
    4: lambda position_rad: force_frame(position_rad, 1.0, 0.5),
}


@pytest.mark.parametrize("mode", [1, 2, 3, 4])
@pytest.mark.parametrize("sent", [1, 2, 3, 4])
def test_each_mode_takes_its_own_commands_only(mode: int, sent: int) -> None:
    driver = in_mode(mode)
    answers = driver.gripper.receive(0.0, HARMLESS[sent](driver.gripper.position_rad))
    assert [decode(answer).status for answer in answers] == ([ENABLED] if sent == mode else [])


@pytest.mark.parametrize("mode", [2, 3, 4])
def test_frames_of_other_modes_do_not_feed_the_watchdog(mode: int) -> None:
    driver = in_mode(mode)
    own = HARMLESS[mode](driver.gripper.position_rad)
    assert driver.stream(0.3, own).status == ENABLED
    assert driver.stream(0.3, command()).status == LOST


@pytest.mark.parametrize("mode", [1, 2, 3, 4])
@pytest.mark.parametrize("on_own_id", [False, True])
def test_special_frames_work_in_every_mode_on_both_ids(mode: int, on_own_id: bool) -> None:
    driver = Driver()
    driver.write(CTRL_MODE, mode)
    base = 0x100 * (mode - 1) if on_own_id else 0

    def ask(frame: CanFrame) -> int:
        return driver.ask(CanFrame(frame.can_id + base, frame.data)).status

    assert ask(ENABLE) == ENABLED
    assert ask(DISABLE) == DISABLED
    ask(ZERO)
    assert driver.ask(STATUS).position_rad == pytest.approx(0.0, abs=4e-4)
    ask(ENABLE)
    driver.wait(0.2)
    assert driver.ask(STATUS).status == LOST
    assert ask(CLEAR) == DISABLED


def test_a_position_is_approached_no_faster_than_commanded() -> None:
    driver = in_mode(2)
    target_rad = driver.gripper.position_rad - 0.5
    fastest = 0.0
    for _ in range(200):
        driver.stream(PERIOD_S, position_frame(target_rad, 0.8))
        fastest = max(fastest, abs(driver.gripper.velocity_rad_s))
    feedback = driver.stream(0.5, position_frame(target_rad, 0.8))
    assert feedback.position_rad == pytest.approx(target_rad, abs=0.01)
    assert fastest == pytest.approx(0.8, abs=0.15)


def test_a_position_counts_from_the_motors_own_zero() -> None:
    driver = Driver()
    driver.ask(ZERO)
    driver.write(CTRL_MODE, 2)
    driver.ask(ENABLE)
    feedback = driver.stream(1.5, position_frame(-0.3, 1.0))
    assert feedback.position_rad == pytest.approx(-0.3, abs=0.01)


@pytest.mark.parametrize("speed_rad_s", [-0.5, 0.4])
def test_a_speed_is_reached_and_kept(speed_rad_s: float) -> None:
    driver = in_mode(3)
    feedback = driver.stream(0.5, velocity_frame(speed_rad_s))
    assert driver.gripper.velocity_rad_s == pytest.approx(speed_rad_s, abs=0.03)
    assert feedback.velocity_rad_s == pytest.approx(speed_rad_s, abs=0.05)
    driver.stream(0.3, velocity_frame(0.0))
    assert driver.gripper.velocity_rad_s == pytest.approx(0.0, abs=0.01)


def test_a_frame_of_eight_bytes_is_a_speed_as_well() -> None:
    driver = in_mode(3)
    padded = CanFrame(0x200 + CAN_ID, struct.pack("<f4x", -0.5))
    driver.stream(0.5, padded)
    assert driver.gripper.velocity_rad_s == pytest.approx(-0.5, abs=0.03)


@pytest.mark.parametrize("share", [0.1, 0.2, 0.4])
def test_force_and_position_presses_with_the_share_of_the_current(share: float) -> None:
    driver = in_mode(4, build_gripper(object_mm=40.0))
    closed_rad = driver.gripper.parameters.closed_rad
    feedback = driver.stream(2.0, force_frame(closed_rad, 1.0, share))
    most_nm = share * driver.gripper.parameters.torque_limit_nm
    assert feedback.torque_nm == pytest.approx(most_nm, abs=0.02)
    assert driver.gripper.opening_mm == pytest.approx(40.0, abs=2.0)


def test_the_registers_of_the_loops_act() -> None:
    slow = in_mode(3)
    slow.write(ACC, 1.0)
    slow.stream(0.25, velocity_frame(-1.0))
    assert slow.gripper.velocity_rad_s == pytest.approx(-0.25, abs=0.1)
    bounded = in_mode(3)
    bounded.write(MAX_SPD, 0.5)
    bounded.stream(0.5, velocity_frame(-2.0))
    assert bounded.gripper.velocity_rad_s == pytest.approx(-0.5, abs=0.05)
    travelled = []
    for gain in (2.0, 20.0):
        driver = in_mode(2)
        start_rad = driver.gripper.position_rad
        driver.write(KP_APR, gain)
        driver.stream(0.2, position_frame(start_rad - 0.3, 5.0))
        travelled.append(start_rad - driver.gripper.position_rad)
    assert travelled[0] < 0.5 * travelled[1]
    first_nm = []
    for gain in (0.001, 0.01):
        driver = in_mode(3)
        driver.gripper.jam()
        driver.write(KP_ASR, gain)
        driver.stream(0.05, velocity_frame(-1.0))
        first_nm.append(abs(driver.gripper.motor_torque_nm))
    assert first_nm[1] - first_nm[0] == pytest.approx(0.009 * 100 * 1.0, rel=0.05)


def test_a_changed_mode_drives_nothing_until_its_first_command() -> None:
    driver = Driver()
    driver.arm()
    driver.stream(0.1, command(q=driver.gripper.position_rad, kp=100.0, kd=2.0, tau=3.0))
    assert driver.gripper.motor_torque_nm != pytest.approx(0.0, abs=0.1)
    driver.write(CTRL_MODE, 3)
    driver.wait(0.03)
    assert driver.gripper.motor_torque_nm == pytest.approx(0.0, abs=1e-6)
    driver.stream(0.3, velocity_frame(-0.5))
    driver.write(CTRL_MODE, 1)
    driver.wait(0.03)
    assert driver.gripper.motor_torque_nm == pytest.approx(0.0, abs=1e-6)


def test_losing_the_connection_disarms_in_every_mode() -> None:
    driver = in_mode(3)
    driver.stream(0.3, velocity_frame(-0.5))
    driver.wait(0.2)
    assert driver.ask(STATUS).status == LOST
    assert driver.gripper.motor_torque_nm == 0.0
    driver.wait(0.5)
    assert driver.gripper.velocity_rad_s == 0.0


@pytest.mark.parametrize(
    "frame",
    [
        position_frame(math.nan, 1.0),
        position_frame(0.0, math.inf),
        CanFrame(0x108, bytes(7)),
        velocity_frame(math.nan),
        CanFrame(0x208, bytes(3)),
        force_frame(math.inf, 1.0, 0.5),
        CanFrame(0x308, bytes(4)),
    ],
)
def test_what_is_no_command_is_not_answered(frame: CanFrame) -> None:
    driver = in_mode(frame.can_id // 0x100 + 1)
    assert driver.gripper.receive(0.0, frame) == []


@pytest.mark.parametrize("mode", [2, 3, 4])
def test_slicing_time_differently_changes_nothing(mode: int) -> None:
    frames = {2: position_frame(-0.9, 1.0), 3: velocity_frame(-0.7), 4: force_frame(0.1, 1.0, 0.2)}
    ends = []
    for slice_s in (0.0003, 0.0125, 0.75):
        driver = Driver(build_gripper(object_mm=40.0))
        driver.write(9, 0)
        driver.write(CTRL_MODE, mode)
        driver.ask(ENABLE)
        driver.ask(frames[mode])
        for _ in range(round(0.75 / slice_s)):
            driver.wait(slice_s)
        driver.gripper.advance(0.75)
        ends.append((driver.gripper.position_rad, driver.gripper.motor_torque_nm))
    assert ends[0] == ends[1] == ends[2]
