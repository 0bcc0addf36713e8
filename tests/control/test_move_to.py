"""Moves to a position: by what they are asked for, how long they take, and what may block them."""

import math

import pytest

from litegripd.control.limiter import LEAD_PERIODS, torque_bound_nm
from litegripd.control.motions.move import SPEED_UP_S
from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import DM4310
from litegripd.model.motion_config import (
    MOVING_KD_NM_S_RAD,
    MOVING_KP_NM_RAD,
    MotionConfig,
    fastest_mm_s,
)
from litegripd.model.motor import MitCommand
from litegripd.motor import codec
from litegripd.sim.plant import MOUNTS
from tests.control.states import at_opening
from tests.world import CAN_ID, PERIOD_S, Client, World, is_command

CONFIG, TRAVEL_MM = MotionConfig(), NOMINAL[0].travel_mm
CODE_RAD, CODE_KP = 25.0 / 65535, 500.0 / 4095
FED_SHARE = 0.4
"""The share of the lead's torque that the velocity may add."""
MOST_MM_S = fastest_mm_s(NOMINAL[0], DM4310)


def arrival_s(world: World, client: Client, opening_mm: float, **params: object) -> float:
    """Run a move to `opening_mm`; return when the jaws were first within half a millimetre."""
    began_s = world.now_s
    number = client.send("motion.move", opening_mm=opening_mm, **params)
    world.run_until(lambda: abs(world.gripper.opening_mm - opening_mm) < 0.5, 60.0)
    arrived_s = world.now_s - began_s
    result = client.wait(number, 60.0)["result"]
    assert (result["ok"], result["outcome"], result["reached"]) == (True, "reached", True)
    return arrived_s


def commands(world: World) -> list[MitCommand]:
    """Return all position commands that were sent."""
    return [
        codec.decode_command(sent.frame.data, world.ranges)
        for sent in world.sent
        if sent.frame.can_id == CAN_ID and is_command(sent.frame)
    ]


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    "target",
    [
        {"opening_mm": 80.0},
        {"opening_mm": 20.0},
        {"openness": 0.75},
        {"openness": 0.0},
        {"openness": 1.0},
        {"position_rad": -0.3},
    ],
)
def test_it_goes_where_it_is_told_to_by_any_quantity(mount: str, target: dict[str, float]) -> None:
    world, client = at_opening(60.0, mount)
    geometry = world.geometry
    result = client.result("motion.move", **target)
    assert (result["ok"], result["outcome"]) == (True, "reached")
    assert (result["reached"], result["stalled"], result["protected"]) == (True, False, False)
    wanted_mm = target.get("opening_mm", target.get("openness", 0.0) * geometry.travel_mm)
    if "position_rad" in target:
        wanted_mm = geometry.opening_mm(target["position_rad"])
    assert geometry.opening_mm(result["target_rad"]) == pytest.approx(wanted_mm, abs=1e-6)
    assert world.gripper.opening_mm == pytest.approx(wanted_mm, abs=1.5)
    world.run(0.5)
    assert world.state.mode == "holding"
    assert abs(world.gripper.velocity_rad_s) < 1e-3


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("duration_s", [0.8, 2.0, 8.0])
@pytest.mark.parametrize("opening_mm", [85.0, 30.0])
def test_it_arrives_in_the_time_that_it_is_given(
    mount: str, duration_s: float, opening_mm: float
) -> None:
    world, client = at_opening(60.0, mount)
    took_s = arrival_s(world, client, opening_mm, duration_s=duration_s)
    assert took_s == pytest.approx(duration_s, rel=0.1)


@pytest.mark.parametrize("speed", [10.0, 50.0, 120.0])
def test_it_goes_at_the_speed_that_it_is_given(speed: float) -> None:
    world, client = at_opening(80.0)
    assert arrival_s(world, client, 20.0, speed_mm_s=speed) == pytest.approx(60.0 / speed, rel=0.1)


@pytest.mark.parametrize(
    ("at_least_s", "arrives_s"), [(2.0, 2.0), (0.5, 75.0 / MOST_MM_S), (0.0, 75.0 / MOST_MM_S)]
)
def test_a_least_time_that_is_too_short_becomes_the_shortest(
    at_least_s: float, arrives_s: float
) -> None:
    world, client = at_opening(80.0)
    took_s = arrival_s(world, client, 5.0, at_least_s=at_least_s)
    assert took_s == pytest.approx(arrives_s, rel=0.1)


@pytest.mark.parametrize(
    ("kp", "kd"), [(150.0, 2.0), (60.0, 1.0), (100.0, 0.5), (500.0, 1.5), (500.0, 5.0)]
)
def test_it_moves_with_the_stiffness_and_damping_that_it_is_given(kp: float, kd: float) -> None:
    """On the way a stiff command is softer, and its velocity pushes no more than its lead may.

    More than the usual gains would swing some grippers, and counts as those.
    """
    world, client = at_opening(60.0)
    number = client.send("motion.move", opening_mm=80.0, kp=kp, kd=kd)
    assert client.wait(number)["result"]["outcome"] == "reached"
    moved = [command for command in commands(world) if abs(command.velocity_rad_s) > 0.3]
    assert len(moved) > 50
    kp, kd = min(kp, MOVING_KP_NM_RAD), min(kd, MOVING_KD_NM_S_RAD)
    push_nm = CONFIG.travel_nm
    for command in moved:
        lead_rad = LEAD_PERIODS * abs(command.velocity_rad_s) * PERIOD_S
        most = min(kp, MOVING_KP_NM_RAD, push_nm / lead_rad)
        assert command.kp_nm_rad == pytest.approx(most, rel=0.03)
        most_kd = FED_SHARE * push_nm / abs(command.velocity_rad_s)
        assert command.kd_nm_s_rad == pytest.approx(min(kd, most_kd), rel=0.03)
    settled = commands(world)[-10]
    assert (settled.kp_nm_rad, settled.kd_nm_s_rad) == pytest.approx(
        (min(kp, MOVING_KP_NM_RAD), kd), abs=0.1
    )


@pytest.mark.parametrize("kp", [100.0, 200.0, 500.0])
def test_stiffer_gains_press_no_harder_on_what_blocks_it(kp: float) -> None:
    world, client = at_opening(60.0)
    world.gripper.put_object(width_mm=50.0)
    number = client.send("motion.move", opening_mm=10.0, kp=kp, kd=2.0)
    strongest_nm = max(client.track(number, lambda: world.torque_nm))
    assert client.answers[number]["result"]["outcome"] == "blocked"
    assert 0.9 * CONFIG.travel_nm < strongest_nm < 1.4 * CONFIG.travel_nm


def test_without_a_speed_it_is_that_of_the_configuration() -> None:
    world, client = at_opening(80.0)
    assert arrival_s(world, client, 20.0) == pytest.approx(60.0 / 50.0, rel=0.1)
    took_s = arrival_s(world, client, 80.0, config={"speed_mm_s": 20.0})
    assert took_s == pytest.approx(60.0 / 20.0, rel=0.1)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    ("from_mm", "to_mm", "duration_s"),
    [
        (60.0, 65.0, 10.0),  # 0.5 mm/s
        (60.0, 55.0, 10.0),
        (60.0, 63.0, 30.0),  # 0.1 mm/s
        (15.0, 8.0, 10.0),
        (8.0, 3.0, 5.0),  # where the closing side sticks
        (60.0, 62.0, 0.5),
        (86.0, 83.0, 6.0),
    ],
)
def test_short_and_slow_moves_arrive(
    mount: str, from_mm: float, to_mm: float, duration_s: float
) -> None:
    """Static friction holds slow jaws for longer than a stall window; they are not blocked."""
    world, client = at_opening(from_mm, mount)
    began_s = world.now_s
    answer = client.call("motion.move", within_s=60.0, opening_mm=to_mm, duration_s=duration_s)
    result = answer["result"]
    assert (result["outcome"], result["stalled"]) == ("reached", False)
    assert world.now_s - began_s == pytest.approx(duration_s + 0.3, rel=0.1)
    assert world.gripper.opening_mm == pytest.approx(to_mm, abs=1.5)


def test_a_slow_speed_is_none_that_stalls() -> None:
    _, client = at_opening(60.0)
    result = client.result("motion.move", opening_mm=61.0, speed_mm_s=0.1)
    assert result["outcome"] == "reached"


def test_a_move_to_where_the_jaws_are_is_over_at_once() -> None:
    world, client = at_opening(60.0)
    began_s = world.now_s
    here_mm = world.state.opening_mm
    timed: tuple[dict[str, float], ...] = ({}, {"duration_s": 5.0})
    for params in timed:
        assert client.result("motion.move", opening_mm=here_mm, **params)["outcome"] == "reached"
    assert world.now_s - began_s < 1.0


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("params", [{}, {"duration_s": 60.0}, {"speed_mm_s": 150.0}])
def test_an_object_in_the_way_blocks_it(mount: str, params: dict[str, float]) -> None:
    world, client = at_opening(60.0, mount)
    world.gripper.put_object(width_mm=50.0)
    number = client.send("motion.move", opening_mm=10.0, **params)
    strongest_nm = asked_nm = 0.0
    while not client.has_answer(number):
        world.tick()
        feedback, command = world.controller.motor.feedback, world.controller.output.command
        assert feedback is not None
        assert command is not None
        asked_nm = max(asked_nm, torque_bound_nm(command, feedback))
        strongest_nm = max(strongest_nm, world.torque_nm)
    result = client.answers[number]["result"]
    assert (result["ok"], result["outcome"]) == (False, "blocked")
    assert (result["reached"], result["stalled"], result["protected"]) == (False, True, False)
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=3.0)
    assert asked_nm <= DM4310.peak_nm + 1e-9
    assert strongest_nm <= DM4310.peak_nm
    world.run(0.5)
    assert world.state.mode == "holding"
    assert world.torque_nm < strongest_nm / 2.0
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=3.0)


def test_a_slow_move_presses_on_an_object_little_more_than_friction_needs() -> None:
    world, client = at_opening(60.0)
    world.gripper.put_object(width_mm=58.0)
    number = client.send("motion.move", opening_mm=50.0, speed_mm_s=1.0)
    strongest_nm = max(client.track(number, lambda: world.torque_nm))
    assert client.answers[number]["result"]["outcome"] == "blocked"
    assert strongest_nm < 1.8


@pytest.mark.parametrize("opening_mm", [0.0, 1.0, 45.0, 86.0])
def test_the_commands_push_is_bounded_in_two_tiers(opening_mm: float) -> None:
    world, client = at_opening(75.0 if opening_mm < 70.0 else 10.0)
    number = client.send("motion.move", opening_mm=opening_mm, speed_mm_s=120.0)
    geometry = world.geometry
    while not client.has_answer(number):
        world.tick()
        feedback = world.measured
        command = world.commands_since(world.now_s)[-1][1]
        here_mm = geometry.opening_mm(feedback.position_rad)
        short_mm = here_mm if opening_mm < 70.0 else geometry.travel_mm - here_mm
        allowed_nm = CONFIG.stop_nm if short_mm <= CONFIG.press_zone_mm else CONFIG.travel_nm
        lead_rad = abs(command.position_rad - feedback.position_rad) - CODE_RAD
        if world.controller.jobs.running is not None:
            assert (command.kp_nm_rad - CODE_KP) * lead_rad <= allowed_nm


@pytest.mark.parametrize(
    ("params", "field"),
    [
        ({"opening_mm": TRAVEL_MM + 1.0}, "opening_mm"),
        ({"opening_mm": -1.0}, "opening_mm"),
        ({"position_rad": 0.2}, "position_rad"),
        ({"opening_mm": 0.0, "duration_s": 0.1}, "duration_s"),
    ],
)
def test_what_cannot_be_is_refused_with_the_limit(params: dict[str, float], field: str) -> None:
    world, client = at_opening(60.0)
    error = client.call("motion.move", **params)["error"]["data"]
    assert (error["reason"], error["field"]) == ("out_of_limits", field)
    assert error["requested"] == params[field]
    limits = error["limit"] if isinstance(error["limit"], list) else [error["limit"]]
    assert all(math.isfinite(limit) for limit in limits)
    assert world.controller.jobs.running is None


@pytest.mark.parametrize(
    "params",
    [
        {},
        {"opening_mm": 10.0, "openness": 0.5},
        {"opening_mm": 10.0, "speed_mm_s": 50.0, "duration_s": 2.0},
        {"opening_mm": 10.0, "at_least_s": 1.0, "duration_s": 2.0},
    ],
)
def test_it_takes_one_target_and_a_speed_or_a_time(params: dict[str, float]) -> None:
    world, client = at_opening(60.0)
    assert client.refusal("motion.move", **params) == "invalid_params"
    assert world.controller.jobs.running is None


def in_place_of_its_own_motion(method: str) -> tuple[World, float]:
    """Have a client's request take the place of its motion; return the world, and the opening."""
    world, client = at_opening(60.0)
    number = client.send("motion.move", opening_mm=10.0)
    world.run(0.3)
    other = world.client(pid=200)
    assert other.refusal(method, if_busy="replace") == "busy"
    assert client.refusal(method) == "busy"
    here_mm = world.state.opening_mm
    assert here_mm is not None
    client.result(method, if_busy="replace")
    assert client.answers[number]["error"]["data"]["reason"] == "replaced"
    return world, here_mm


def test_the_jaws_go_slack_in_place_of_the_clients_own_motion_but_of_no_other() -> None:
    world, _ = in_place_of_its_own_motion("motion.zero_gravity")
    world.tick()
    last = commands(world)[-1]
    last_gains = (last.kp_nm_rad, last.kd_nm_s_rad, last.torque_nm)
    assert last_gains == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert world.state.mode == "relaxed"


def test_a_hold_freezes_the_jaws_in_place_of_the_clients_own_motion_but_of_no_other() -> None:
    world, here_mm = in_place_of_its_own_motion("motion.hold")
    world.run(1.0)
    assert world.state.mode == "holding"
    assert world.state.opening_mm == pytest.approx(here_mm, abs=2.0)


def test_a_hold_waits_for_the_end_of_a_motion_if_it_is_queued() -> None:
    world, client = at_opening(60.0)
    client.send("motion.move", opening_mm=50.0)
    client.result("motion.hold", if_busy="queue")
    assert world.state.opening_mm == pytest.approx(50.0, abs=0.5)


def test_progress_tells_phase_and_steps() -> None:
    _world, client = at_opening(60.0)
    number = client.send("motion.move", opening_mm=85.0, progress=True)
    client.wait(number)
    reports = client.told("job.progress")
    phases = [report["phase"] for report in reports]
    assert sorted(set(phases), key=phases.index) == ["ramp", "settle"]
    total = reports[0]["total_steps"]
    assert total == pytest.approx((25.0 / 50.0 + 0.5 * SPEED_UP_S) / PERIOD_S, abs=2)
    assert all(report["step"] <= total for report in reports)
