"""A position that no jaw can have got to: never acted upon, and told when it stays."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.frame import CanFrame
from litegripd.model.motor import Feedback, MotorPhase
from litegripd.motor.plausibility import IMPLAUSIBLE_FRAMES, Plausibility
from tests.world import CAN_ID, PERIOD_S, Client, World

MOVED_BY_ITSELF_MM = 15.0
"""What the motor does with all its torque in the period before it tells of the jump, and in the one
in which the answer is under way."""

CODES_PER_RAD = 65535 / 25.0


def shifted(frame: CanFrame, by_rad: float) -> CanFrame:
    """Let a feedback frame tell another position; beyond the range it wraps, as the motor's do."""
    (code,) = struct.unpack_from(">H", frame.data, 1)
    code = (code + round(by_rad * CODES_PER_RAD)) % 65536
    return CanFrame(frame.can_id, frame.data[:1] + struct.pack(">H", code) + frame.data[3:])


def jump(world: World, by_rad: float, frames: float = float("inf")) -> None:
    """From now on the motor tells a position that is off, for so many frames."""
    left = frames

    def replaced(frame: CanFrame) -> bool:
        nonlocal left
        if left <= 0 or frame.data[0] & 0x0F != CAN_ID or frame.data[2] in (0x33, 0x55):
            return False
        left -= 1
        world.inject(shifted(frame, by_rad))
        return True

    world.lose_from_motor = replaced


def holding(world: World) -> Client:
    client = world.enabled()
    client.result("motion.move", opening_mm=60)
    return client


@pytest.mark.parametrize("by_rad", [0.2, -0.2, 0.5, 6.283, -6.283, 12.5])
def test_a_jump_that_stays_ends_in_a_disabled_motor_and_moves_nothing(by_rad: float) -> None:
    world = World()
    client = holding(world)
    before_mm = world.gripper.opening_mm
    since_s = world.now_s
    world.gripper.jump(by_rad)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 1.0)
    assert world.machine.motor.counters.implausible_frames == IMPLAUSIBLE_FRAMES
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=MOVED_BY_ITSELF_MM)
    late = [c for at_s, c in world.commands_since(since_s) if at_s > since_s + 2.5 * PERIOD_S]
    assert all(c.kp_nm_rad == 0.0 and abs(c.torque_nm) < 0.003 for c in late)
    world.run(0.3)
    before_mm = world.gripper.opening_mm
    for method in ("motor.enable", "motion.open"):
        assert client.refusal(method) == "implausible_feedback"
    hint = client.call("motor.enable")["error"]["data"]["hint"]
    assert hint.startswith("look where the jaws are, and power-cycle the motor")
    assert "; then motor.clear_fault" in hint
    assert client.result("motor.clear_fault")["cleared"] == "implausible_feedback"
    assert client.refusal("motion.open") == "not_enabled"
    assert client.result("motor.enable")["ok"]
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.5)


@pytest.mark.parametrize("frames", [1, IMPLAUSIBLE_FRAMES - 1])
def test_a_disturbed_frame_or_two_end_nothing(frames: int) -> None:
    world = World()
    client = holding(world)
    number = client.send("motion.open")
    world.run(0.2)
    jump(world, 1.0, frames)
    world.run_until(lambda: client.has_answer(number))
    assert client.answers[number]["result"]["ok"]
    assert world.machine.motor.counters.implausible_frames == frames


def test_a_motion_that_ends_by_a_jump_says_so() -> None:
    world = World()
    client = holding(world)
    number = client.send("motion.close")
    world.run(0.2)
    jump(world, 1.0)
    world.run_until(lambda: client.has_answer(number), 1.0)
    assert client.answers[number]["error"]["data"]["reason"] == "implausible_feedback"


def test_jaws_that_a_hand_moves_fast_are_plausible() -> None:
    world = World()
    holding(world)
    for torque_nm in (8.0, -8.0, 5.0, 0.0):
        world.gripper.push(torque_nm)
        world.run(0.15)
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.machine.motor.counters.implausible_frames == 0


def told(at_s: float, position_rad: float, velocity_rad_s: float, status: int = 1) -> Feedback:
    return Feedback(status, position_rad, velocity_rad_s, 0.0, 30, 30, at_s)


@given(
    velocity=st.floats(-29.0, 29.0),
    acceleration=st.floats(-5000.0, 5000.0),
    elapsed=st.floats(0.0, 0.02),
)
def test_whatever_torque_can_do_is_plausible(
    velocity: float, acceleration: float, elapsed: float
) -> None:
    judge = Plausibility()
    assert judge.accepts(told(0.0, 0.0, velocity), 29.7)
    way = velocity * elapsed + acceleration * elapsed**2 / 2.0
    assert judge.accepts(told(elapsed, way, velocity + acceleration * elapsed), 29.7)


def test_a_motor_that_is_not_enabled_may_be_anywhere() -> None:
    judge = Plausibility()
    assert judge.accepts(told(0.0, 0.0, 0.0), 29.7)
    assert judge.accepts(told(0.005, 6.28, 0.0, status=0), 29.7)
    assert judge.accepts(told(0.010, 0.0, 0.0, status=0xD), 29.7)
    assert not judge.accepts(told(0.015, 6.28, 0.0), 29.7)


def test_a_speed_beyond_what_a_frame_can_tell_is_not_judged() -> None:
    judge = Plausibility()
    assert judge.accepts(told(0.0, 0.0, 30.0), 29.7)
    assert judge.accepts(told(0.005, 0.4, 30.0), 29.7)
    assert judge.accepts(told(0.010, 0.5, 5.0), 29.7)
    assert not judge.accepts(told(0.015, 0.9, 5.0), 29.7)
