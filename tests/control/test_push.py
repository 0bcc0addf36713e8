"""Set-points of torque: bounded in speed, force and travel, slack at 0, and lapsing as all do."""

from itertools import pairwise
from typing import Any

import pytest

from litegripd.control.holds import Hold
from litegripd.control.motions.stream import PUSHED_RAD_S, RAMP_NM_S
from litegripd.model.calibration import NOMINAL
from litegripd.model.motion_config import MotionConfig
from litegripd.motor import codec
from litegripd.sim.plant import MOUNTS
from tests.control.test_given_calibration import given
from tests.world import Client, World, ready

MM_RAD, TRAVEL_MM = NOMINAL[0].rad_to_mm, NOMINAL[0].travel_mm
LEAST_NM = 10.0 / 4095 * 1.01  # the two codes next to zero; there is none for zero
STOP_NM = MotionConfig().stop_nm
CLOSING = {"normal": 1.0, "reverse": -1.0}


def gripper(
    mount: str = "normal", opening_mm: float = 60.0, *, calibrated: bool = True
) -> tuple[World, Client]:
    return ready(mount, calibrated, initial_opening_mm=opening_mm)


def stream(world: World, client: Client, duration_s: float, **params: Any) -> float:
    """Keep a stream up by a set-point every 20 ms; return the fastest speed, in rad/s."""
    fastest_rad_s = 0.0
    for number in range(round(duration_s / world.period_s)):
        if number % 4 == 0:
            client.notify("stream.set", **params)
        world.tick()
        fastest_rad_s = max(fastest_rad_s, abs(world.gripper.velocity_rad_s))
    return fastest_rad_s


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("push_nm", [0.5, 2.0, 4.0, -0.5, -2.0, -4.0])
def test_free_jaws_are_not_flung_and_press_gently_on_the_stop(mount: str, push_nm: float) -> None:
    world, client = gripper(mount, 45.0)
    assert stream(world, client, 3.0, push_nm=push_nm) <= PUSHED_RAD_S
    closes = push_nm * CLOSING[mount] > 0.0
    assert world.gripper.opening_mm == pytest.approx(0.0 if closes else TRAVEL_MM, abs=2.5)
    expected_nm = min(abs(push_nm), STOP_NM)
    assert world.torque_nm == pytest.approx(expected_nm, abs=0.05)
    assert world.gripper.motor_torque_nm * push_nm > 0.0


@pytest.mark.parametrize("push_nm", [1.0, 3.0, 4.0])
def test_an_object_gets_the_torque_without_a_claim_that_it_is_held(push_nm: float) -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0)
    stream(world, client, 4.0, push_nm=push_nm)
    assert world.gripper.motor_torque_nm == pytest.approx(push_nm, abs=0.02)
    state = world.state
    assert (state.is_grasped, state.clamp_n, state.force_set_n) == (False, None, None)
    assert state.requested_torque_nm == pytest.approx(push_nm)
    assert state.limited == ()
    assert [event.kind for event in world.service.take_events()].count("pressing") == 0


def test_the_torque_ramps() -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=44.0)
    stream(world, client, 1.0, push_nm=1.0)
    since_s = world.now_s
    stream(world, client, 0.5, push_nm=4.0)
    torques = [command.torque_nm for _, command in world.commands_since(since_s)]
    steps = [later - earlier for earlier, later in pairwise(torques)]
    assert max(steps) <= RAMP_NM_S * world.period_s + 2.0 * LEAST_NM
    assert torques[-1] == pytest.approx(4.0, abs=LEAST_NM)


@pytest.mark.parametrize("push_nm", [-4.01, 4.01, 1e9, -1e9])
def test_more_than_a_grip_may_have_is_refused_with_the_limit(push_nm: float) -> None:
    world, client = gripper()
    answer = client.call("stream.set", push_nm=push_nm)["error"]
    assert (answer["data"]["reason"], answer["data"]["field"]) == ("out_of_limits", "push_nm")
    assert answer["data"]["limit"] == [-4.0, 4.0]
    client.result("calibration.load", content=given(nm_to_n=20.0))
    assert client.call("stream.set", push_nm=2.1)["error"]["data"]["limit"] == [-2.0, 2.0]
    assert "result" in client.call("stream.set", push_nm=2.0)
    world.run(0.5)


@pytest.mark.parametrize(
    ("params", "names"),
    [
        ({"push_nm": 1.0, "opening_mm": 40.0}, "exactly one"),
        ({"push_nm": 0.0, "openness": 0.4}, "exactly one"),
        ({"push_nm": 1.0, "kp": 50.0}, "kp does not go with push_nm"),
        ({"push_nm": 1.0, "kd": 1.0}, "kd does not go with push_nm"),
        ({"push_nm": 1.0, "torque_nm": 1.0}, "torque_nm does not go with push_nm"),
        ({"push_nm": 1.0, "speed_mm_s": 20.0}, "speed_mm_s does not go with push_nm"),
        ({"push_nm": "1"}, "number"),
        ({}, "opening_mm, position_rad, openness, push_nm"),
    ],
)
def test_what_does_not_go_together_is_said(params: dict[str, Any], names: str) -> None:
    _world, client = gripper()
    answer = client.call("stream.set", **params)["error"]
    assert answer["data"]["reason"] == "invalid_params"
    assert names in answer["message"]


def test_slack_needs_no_calibration_and_a_push_does() -> None:
    world, client = gripper(calibrated=False)
    assert client.refusal("stream.set", push_nm=1.0) == "not_calibrated"
    stream(world, client, 0.3, push_nm=0.0)
    assert client.refusal("stream.set", push_nm=1.0) == "not_calibrated"
    stream(world, client, 1.0, push_nm=1.0, calibration=given())
    assert world.gripper.opening_mm < 20.0


def test_slack_jaws_are_moved_by_a_hand_against_friction_alone() -> None:
    world, client = gripper(opening_mm=30.0)
    stream(world, client, 0.1, push_nm=0.0)
    since_s, began_mm = world.now_s, world.gripper.opening_mm
    world.gripper.push(-0.3)  # the breakaway friction is 0.21 N·m
    stream(world, client, 0.5, push_nm=0.0)
    assert world.gripper.opening_mm - began_mm > 20.0
    for _, command in world.commands_since(since_s):
        assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0
        assert abs(command.torque_nm) <= LEAST_NM


def test_far_outside_the_travel_jaws_may_go_slack_and_are_not_pushed() -> None:
    world, client = gripper()
    away = given(zero_position_rad=6.0, max_position_rad=4.4)
    assert client.refusal("stream.set", push_nm=1.0, calibration=away) == "out_of_limits"
    assert "result" in client.call("stream.set", push_nm=0.0, calibration=away)
    world.run(0.1)


@pytest.mark.parametrize("push_nm", [-1.0, 1.0])
def test_beyond_the_bounds_nothing_pushes_further_out(push_nm: float) -> None:
    """With limits that are too narrow: jaws that are outside are pushed back only."""
    world, client = gripper(opening_mm=45.0)
    here_rad = world.gripper.position_rad
    half_rad = 0.4 * NOMINAL[0].travel_rad
    calibration = {
        "zero_position_rad": here_rad + half_rad,
        "max_position_rad": here_rad - half_rad,
        "rad_to_mm": MM_RAD / 0.8,
    }
    stream(world, client, 3.0, push_nm=push_nm, calibration=calibration)
    beyond_rad = abs(world.gripper.position_rad - here_rad) - half_rad
    assert 0.0 < beyond_rad <= 0.05 * 2.0 * half_rad + 0.02  # 1 mm to stop in
    assert world.torque_nm <= 0.02
    stream(world, client, 0.2, push_nm=-push_nm, calibration=calibration)
    assert abs(world.gripper.position_rad - here_rad) < half_rad + beyond_rad - 0.01


@pytest.mark.parametrize("valid_s", [0.05, 0.2])
def test_it_lapses_and_the_jaws_hold_where_they_are_without_pressing(valid_s: float) -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0)
    job = client.result("stream.set", push_nm=3.0, valid_s=2.0)["job"]
    world.run(1.5)
    client.result("stream.set", push_nm=3.0, valid_s=valid_s)
    world.run(valid_s - 0.02)
    assert world.gripper.motor_torque_nm == pytest.approx(3.0, abs=0.05)
    world.run(0.25)  # of which the torque takes 0.2 s to end
    assert client.call("job.wait", job=job)["result"]["state"] == "done"
    idle = world.controller.idle
    assert isinstance(idle, Hold)
    assert (idle.gains, idle.press_nm) == (world.controller.gains, None)
    here_rad = world.gripper.position_rad
    assert idle.position_rad == pytest.approx(here_rad, abs=0.06)
    world.run(2.0)
    assert world.torque_nm <= STOP_NM + 0.02


def test_running_jaws_are_caught_when_it_lapses() -> None:
    world, client = gripper(opening_mm=70.0)
    stream(world, client, 0.3, push_nm=2.0)
    world.run(0.21)
    here_mm = world.gripper.opening_mm
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=1.5)
    assert world.state.mode == "holding"


@pytest.mark.parametrize("stiffness", [10.0, 30.0, 300.0])
@pytest.mark.parametrize("push_nm", [2.0, 4.0])
def test_an_elastic_object_does_not_throw_open_jaws_that_become_slack(
    push_nm: float, stiffness: float
) -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0, stiffness_nm_rad=stiffness)
    stream(world, client, 1.5, push_nm=push_nm)
    assert stream(world, client, 1.0, push_nm=0.0) <= PUSHED_RAD_S
    assert world.torque_nm <= LEAST_NM
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0, stiffness_nm_rad=stiffness)
    stream(world, client, 1.5, push_nm=push_nm)
    assert stream(world, client, 1.5, opening_mm=60.0, speed_mm_s=50.0) <= PUSHED_RAD_S
    assert world.gripper.opening_mm == pytest.approx(60.0, abs=1.0)


def test_position_slack_and_torque_are_one_job() -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0)
    for params in ({"opening_mm": 50.0}, {"push_nm": 0.0}, {"push_nm": 2.0}, {"opening_mm": 60.0}):
        stream(world, client, 1.0, **params)
    assert world.gripper.opening_mm == pytest.approx(60.0, abs=0.5)
    assert [job.kind for job in world.controller.jobs].count("stream") == 1


def test_a_stop_ends_it_and_latches_while_zero_set_points_do_not() -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0)
    stream(world, client, 1.0, push_nm=3.0)
    client.result("stop")
    assert client.refusal("stream.set", push_nm=3.0) == "stopped"
    assert client.refusal("stream.set", push_nm=0.0) == "stopped"
    world.run(2.0)
    assert world.torque_nm <= STOP_NM + 0.05
    client.result("stop.clear")
    stream(world, client, 0.5, push_nm=0.0)
    assert world.controller.stop_latch.latched is None


@pytest.mark.parametrize("as_stream", [True, False])
def test_a_stop_50_times_a_second_makes_two_events_and_no_more(as_stream: bool) -> None:
    world, client = gripper()
    client.result("motion.open")
    while world.service.take_events():
        world.tick()
    opened = [job.number for job in world.controller.jobs]
    for _ in range(250):
        if as_stream:
            client.notify("stream.set", push_nm=0.0)
        else:
            client.send("motion.zero_gravity")
        world.run(0.02)
    client.read()
    assert all("result" in answer for answer in client.answers.values())
    told = world.service.take_events()
    assert [event.kind for event in told] in (["job_started"], ["job_started", "job_ended"])
    assert [job.number for job in world.controller.jobs][: len(opened)] == opened
    assert len(list(world.controller.jobs)) == len(opened) + 1
    assert world.controller.stop_latch.generation == 0


def test_another_clients_push_is_refused_while_one_runs() -> None:
    world, client = gripper()
    other = world.client()
    stream(world, client, 0.1, push_nm=0.0)
    assert other.refusal("stream.set", push_nm=1.0) == "busy"
    assert other.refusal("motion.set_force", force_n=5.0) == "busy"
    assert client.refusal("motion.set_force", force_n=5.0) == "busy"


def test_an_old_measurement_lets_no_torque_rise() -> None:
    world, client = gripper(opening_mm=60.0)
    stream(world, client, 0.05, push_nm=4.0)
    since_s = world.now_s
    world.lose_from_motor = lambda _frame: True
    stream(world, client, 0.04, push_nm=4.0)
    torques = [command.torque_nm for _, command in world.commands_since(since_s + 0.012)]
    assert max(torques) <= torques[0] + LEAST_NM


def test_it_may_hold_for_long_what_a_grip_may() -> None:
    """40 N are above the rating: only a hold by force may have them for longer than a moment."""
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0)
    stream(world, client, 20.0, push_nm=4.0)
    assert world.gripper.motor_torque_nm == pytest.approx(4.0, abs=0.02)


def test_a_hot_coil_lowers_it() -> None:
    world, client = ready(initial_opening_mm=45.0, ambient_c=72.0)
    world.gripper.put_object(width_mm=40.0)
    stream(world, client, 60.0, push_nm=4.0)
    assert world.gripper.motor.coil_c < 81.5
    assert world.state.limited == ("heat",)


def test_what_is_sent_is_decoded_as_it_was_meant() -> None:
    """The sign is the motor's own: positive turns towards increasing radians, on each mount."""
    for mount in MOUNTS:
        world, client = gripper(mount, 45.0)
        before_rad = world.gripper.position_rad
        stream(world, client, 0.3, push_nm=1.0)
        assert world.gripper.position_rad > before_rad + 0.05
        last = codec.decode_command(world.sent[-1].frame.data, world.ranges)
        assert last.torque_nm == pytest.approx(1.0, abs=LEAST_NM)
        assert last.kp_nm_rad == 0.0


def test_a_client_that_dies_leaves_no_push_behind() -> None:
    world, client = gripper(opening_mm=45.0)
    world.gripper.put_object(width_mm=40.0)
    stream(world, client, 1.5, push_nm=4.0)
    client.leave()
    world.run(1.0)
    assert world.controller.jobs.running is None
    assert world.torque_nm <= STOP_NM + 0.05
