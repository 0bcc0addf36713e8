"""A position that no jaw can have reached: never acted upon, and reported when it stays."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.calibration import Calibration
from litegripd.model.motor import CanFrame, Feedback, MotorPhase, Status
from litegripd.motor.exchange import IMPLAUSIBLE_FRAMES, Plausibility
from tests.motor.helpers import replace_answers
from tests.world import (
    CAN_ID,
    PERIOD_S,
    Client,
    World,
    enabled_world,
    found_world,
    reason_of,
)

MOVED_BY_ITSELF_MM = 15.0
"""What the motor does with all its torque in the period before it reports the jump, and in the one
in which the answer is under way."""

CODES_PER_RAD = 65535 / 25.0


def shifted(frame: CanFrame, by_rad: float) -> CanFrame:
    """Give a feedback frame another position; beyond the range it wraps, as the motor's do."""
    (code,) = struct.unpack_from(">H", frame.data, 1)
    code = (code + round(by_rad * CODES_PER_RAD)) % 65536
    return CanFrame(frame.can_id, frame.data[:1] + struct.pack(">H", code) + frame.data[3:])


def jump(world: World, by_rad: float, frames: float = float("inf")) -> None:
    """From now on the motor reports a wrong position, for `frames` frames."""

    def other(frame: CanFrame) -> CanFrame | None:
        is_feedback = frame.data[0] & 0x0F == CAN_ID and frame.data[2] not in (0x33, 0x55)
        return shifted(frame, by_rad) if is_feedback else None

    replace_answers(world, other, frames)


def holding() -> tuple[World, Client]:
    world, client = enabled_world()
    client.result("motion.move", opening_mm=60)
    return world, client


@pytest.mark.parametrize("by_rad", [0.25, -0.25, 0.5, 6.283, -6.283, 12.5])
def test_a_jump_that_stays_ends_in_a_disabled_motor_and_moves_nothing(by_rad: float) -> None:
    world, client = holding()
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
    world, client = holding()
    number = client.send("motion.open")
    world.run(0.2)
    jump(world, 1.0, frames)
    assert client.wait(number)["result"]["ok"]
    assert world.machine.motor.counters.implausible_frames == frames


def test_a_motion_that_ends_by_a_jump_says_so() -> None:
    world, client = holding()
    number = client.send("motion.close")
    world.run(0.2)
    jump(world, 1.0)
    assert reason_of(client.wait(number, 1.0)) == "implausible_feedback"


def test_jaws_that_a_hand_moves_fast_are_plausible() -> None:
    world, _ = holding()
    for torque_nm in (8.0, -8.0, 5.0, 0.0):
        world.gripper.push(torque_nm)
        world.run(0.15)
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.machine.motor.counters.implausible_frames == 0


def reported(at_s: float, position_rad: float, velocity_rad_s: float, status: int = 1) -> Feedback:
    return Feedback(status, position_rad, velocity_rad_s, 0.0, 30, 30, at_s)


SPEEDS, ACCELERATIONS = st.floats(-29.0, 29.0), st.floats(-5000.0, 5000.0)


def reported_after(elapsed: float, velocity: float, acceleration: float) -> Feedback:
    """Return the report of jaws that were at 0 with this velocity and have accelerated since."""
    way = velocity * elapsed + acceleration * elapsed**2 / 2.0
    return reported(elapsed, way, velocity + acceleration * elapsed)


@given(velocity=SPEEDS, acceleration=ACCELERATIONS, elapsed=st.floats(0.0, 0.005))
def test_whatever_torque_can_do_in_a_period_is_plausible(
    velocity: float, acceleration: float, elapsed: float
) -> None:
    judge = Plausibility()
    assert accepts(judge, reported(0.0, 0.0, velocity))
    assert accepts(judge, reported_after(elapsed, velocity, acceleration))


@given(velocity=SPEEDS, acceleration=ACCELERATIONS, elapsed=st.floats(0.0, 0.02))
def test_whatever_torque_can_do_in_a_gap_is_plausible_by_two_frames(
    velocity: float, acceleration: float, elapsed: float
) -> None:
    judge = Plausibility()
    assert accepts(judge, reported(0.0, 0.0, velocity))
    first = reported_after(elapsed, velocity, acceleration)
    if not accepts(judge, first):
        way, then = first.position_rad, first.velocity_rad_s
        assert accepts(judge, reported(elapsed + 0.005, way + then * 0.005, then))
    assert judge.refusal is None


COURSES: dict[str, list[tuple[bool, Feedback]]] = {
    "a motor that is not enabled may be anywhere": [
        (True, reported(0.0, 0.0, 0.0)),
        (True, reported(0.005, 6.28, 0.0, status=0)),
        (True, reported(0.010, 0.0, 0.0, status=0xD)),
        (False, reported(0.015, 6.28, 0.0)),
    ],
    "a speed beyond what a frame can tell is not judged": [
        (True, reported(0.0, 0.0, 30.0)),
        (True, reported(0.005, 0.4, 30.0)),
        (True, reported(0.010, 0.5, 5.0)),
        (False, reported(0.015, 0.9, 5.0)),
    ],
    "a jump after a gap is believed by two frames that agree": [
        (True, reported(0.0, 0.0, 0.0)),
        (False, reported(0.020, 0.3, 0.0)),  # it may be disturbed
        (True, reported(0.025, 0.01, 0.0)),  # it was
        (False, reported(0.045, 0.3, 0.0)),
        (True, reported(0.050, 0.3, 0.0)),
    ],
    # A little off in its position, and in its speed the other way.
    "a disturbed frame that was believed does not put the true ones in doubt for long": [
        (True, reported(0.0, 0.0, 0.0)),
        (True, reported(0.005, 0.08, 25.0)),
        (False, reported(0.010, 0.0, 0.0)),
        (True, reported(0.015, 0.0, 0.0)),
    ],
}


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_frame_by_frame(course: list[tuple[bool, Feedback]]) -> None:
    judge = Plausibility()
    assert [accepts(judge, feedback) for _, feedback in course] == [taken for taken, _ in course]
    assert judge.refusal is None


def test_a_jump_of_slack_jaws_is_believed_when_it_stays() -> None:
    judge = Plausibility()
    assert accepts(judge, reported(0.0, 0.0, 0.0))
    answers = [
        judge.accepts(reported(0.005 * tick, 1.0, 0.0), 29.7, is_driven=False) for tick in (1, 2, 3)
    ]
    assert answers == [False, False, True]
    assert judge.refusal is None


def accepts(judge: Plausibility, feedback: Feedback) -> bool:
    return judge.accepts(feedback, 29.7, is_driven=True)


DISTURBED_MM = 1.0
"""A frame off by 0.3 rad, 21 mm, moves the jaws by no more."""


def off_once(world: World) -> None:
    jump(world, 0.3, 1)


def test_a_disturbed_frame_that_confirms_the_enabling_is_not_held_on_to() -> None:
    world, client = found_world()
    before_mm = world.gripper.opening_mm

    def other(frame: CanFrame) -> CanFrame | None:
        return shifted(frame, 0.3) if frame.data[0] >> 4 == Status.ENABLED else None

    replace_answers(world, other, 1)
    client.call("motor.enable")
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=DISTURBED_MM)
    assert world.in_phase(MotorPhase.ENABLED)


@pytest.mark.parametrize("silent_ticks", [2, 4, 8])
def test_a_disturbed_frame_after_a_silence_is_not_held_on_to(silent_ticks: int) -> None:
    world, _ = holding()
    before_mm = world.gripper.opening_mm
    world.lose_from_motor = lambda _frame: True
    world.run(silent_ticks * PERIOD_S)
    off_once(world)
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=DISTURBED_MM)
    assert world.in_phase(MotorPhase.ENABLED)


def test_a_disturbed_frame_of_slack_jaws_is_not_held_on_to() -> None:
    world, client = holding()
    client.result("motion.zero_gravity")
    world.run(0.1)
    before_mm = world.gripper.opening_mm
    off_once(world)
    world.tick()
    client.send("motion.hold")
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=DISTURBED_MM)


GRIPPED_NM = 1.0


def gripping() -> tuple[World, Client, int]:
    """Begin to hold something by force; return the request, too."""
    world, client = enabled_world()
    world.gripper.put_object(width_mm=55.0)
    number = client.send("motion.grasp", force_n=10.0 * GRIPPED_NM)
    world.run_until(lambda: world.state.is_grasped)
    world.run(1.0)
    return world, client, number


@pytest.mark.parametrize("by_rad", [0.3, -0.3, 0.75, 1.5, -1.5, 6.283])
@pytest.mark.parametrize("frames", [1, IMPLAUSIBLE_FRAMES - 1])
def test_disturbed_frames_do_not_end_a_grip(by_rad: float, frames: int) -> None:
    world, client, number = gripping()
    jump(world, by_rad, frames)
    for _ in range(200):
        world.tick()
        squeeze_nm = world.gripper.parameters.close_sign * world.gripper.motor_torque_nm
        assert squeeze_nm == pytest.approx(GRIPPED_NM, abs=0.15)
    assert not client.has_answer(number)
    assert world.state.is_grasped
    assert world.machine.motor.counters.implausible_frames == frames


@pytest.mark.parametrize("by_rad", [0.3, -0.3, 1.5, -1.5, 6.283, -6.283])
def test_a_jump_that_stays_ends_a_grip(by_rad: float) -> None:
    """It may not hold on by a torque that nobody knows: the motor turns by its encoder."""
    world, client, number = gripping()
    world.gripper.jump(by_rad)
    assert reason_of(client.wait(number, 1.0)) == "implausible_feedback"
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 1.0)
    assert client.refusal("motor.enable") == "implausible_feedback"


def test_a_jump_is_told_as_an_event_once_even_after_the_motor_was_away() -> None:
    world, client = holding()
    client.result("events.subscribe", kinds=["implausible"])
    world.gripper.jump(0.5)
    world.run(1.0)
    (event,) = client.told("event")
    assert 0.2 < event["data"]["jump_rad"] < 0.6  # the jaws have followed it meanwhile
    assert "motor.clear_fault" in event["message"]
    world.gripper.power_off()
    world.run(2.0)
    world.gripper.power_on()
    world.run(2.0)
    assert client.refusal("motor.enable") == "implausible_feedback"
    assert client.told("event") == [event]


@pytest.mark.parametrize("by_rad", [-0.5, 1.5, 6.283])
def test_without_damping_a_jump_that_stays_disables_the_motor_all_the_same(by_rad: float) -> None:
    world, client = found_world()
    geometry = world.controller.geometry
    assert geometry is not None
    world.controller.use_calibration(Calibration(geometry, kp_nm_rad=100.0, kd_nm_s_rad=0.0), None)
    client.result("motor.enable")
    client.result("motion.move", opening_mm=60)
    world.gripper.jump(by_rad)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 1.0)


def test_late_answers_that_come_together_are_no_jump() -> None:
    """They are dated alike, because nothing distinguishes them; the jaws moved between them."""
    judge = Plausibility()
    speed_rad_s, period_s = 10.0, 0.010
    assert accepts(judge, reported(0.0, 0.0, speed_rad_s))
    for tick in range(1, 4):
        assert accepts(judge, reported(tick * period_s, speed_rad_s * tick * period_s, speed_rad_s))
    for tick in range(4, 8):
        accepts(judge, reported(4 * period_s, speed_rad_s * tick * period_s, speed_rad_s))
    assert judge.refusal is None


def test_a_bounce_that_each_measurement_leads_to_is_no_jump() -> None:
    """Of jaws thrown at 1.4 m/s, at 100 Hz: between two, full torque may do more than in 5 ms."""
    judge = Plausibility()
    bounce = [(-1.081, 12.5), (-1.230, -18.6), (-1.296, 4.2), (-1.344, -9.4), (-1.42, -7.0)]
    for tick, (position_rad, velocity_rad_s) in enumerate(bounce):
        accepts(judge, reported(0.010 * tick, position_rad, velocity_rad_s))
    assert judge.refusal is None
    assert judge.in_a_row == 0


@pytest.mark.parametrize("speed_rad_s", [0.0, 0.5, 6.9, 7.0, 7.1, 10.0, 14.0, 20.0, 29.9])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_motor_in_doubt_is_braked_by_no_more_than_its_peak(
    speed_rad_s: float, sign: float
) -> None:
    judge = Plausibility()
    judge.believe(reported(0.0, 0.0, sign * speed_rad_s))
    expected = 1.0 if speed_rad_s <= 7.0 else 7.0 / speed_rad_s
    assert judge.brake_kd_nm_s_rad == pytest.approx(expected)
    assert judge.brake_kd_nm_s_rad * speed_rad_s <= 7.0 + 1e-9


def test_fast_jaws_whose_position_is_in_doubt_are_braked_by_no_more_than_their_peak() -> None:
    """The speed that was believed last counts: a hand throws them, and a hold is to catch them."""
    world, client = holding()
    client.result("motion.zero_gravity")
    world.gripper.push(2.0)
    world.run_until(lambda: abs(world.gripper.velocity_rad_s) > 9.6, 1.0)
    off_once(world)
    world.tick()
    feedback = world.machine.motor.view().feedback
    assert feedback is not None
    client.send("motion.hold")
    world.tick()
    assert world.machine.motor.counters.implausible_frames == 1
    _, command = world.commands_since(world.now_s)[-1]
    assert command.kp_nm_rad == 0.0
    assert command.torque_nm == pytest.approx(0.0, abs=0.003)
    assert abs(feedback.velocity_rad_s) > 8.0
    assert command.kd_nm_s_rad == pytest.approx(7.0 / abs(feedback.velocity_rad_s), abs=0.002)
