"""No motion is faster than 150 mm/s, nor than the motor's own bound, whatever the scale says."""

from dataclasses import replace
from typing import Any

import pytest

from litegripd.control.limiter import DEFAULT_GAINS, CommandLimiter, bounds_of, lead_within
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import DM4310, FASTEST_MM_S, MotorType
from litegripd.model.motion_config import MOST_PUSH_NM, MotionConfig, fastest_mm_s
from litegripd.model.motor import Feedback, MitCommand
from tests.world import Client, World, ready

SMALL_MM_RAD = 20.0
"""A wrong scale: what it calls slow is fast."""
OVERSHOOT = 1.15
MOTIONS: dict[str, dict[str, Any]] = {
    "motion.open": {},
    "motion.close": {},
    "motion.move": {"opening_mm": 10.0},
    "motion.grasp": {"until": "verdict"},
    "stream.set": {"opening_mm": 10.0},
}
every_motion = pytest.mark.parametrize(("method", "params"), MOTIONS.items(), ids=MOTIONS)


def scaled(rad_to_mm: float, motor_type: MotorType = DM4310) -> tuple[World, Client]:
    world = World(motor_type=motor_type)
    geometry = replace(NOMINAL[0], rad_to_mm=rad_to_mm)
    world.controller.use_calibration(Calibration(geometry))
    return world, world.enabled()


def stands_still(world: World) -> bool:
    before_rad = world.gripper.position_rad
    world.run(0.2)
    return world.controller.jobs.running is None and (
        abs(world.gripper.position_rad - before_rad) < 1e-3
    )


@every_motion
def test_more_than_150_mm_s_cannot_be_asked_for(method: str, params: dict[str, Any]) -> None:
    world, client = ready()
    answer = client.call(method, **params, speed_mm_s=FASTEST_MM_S + 1.0)["error"]
    assert answer["data"]["reason"] == "invalid_params"
    assert f"0.1 to {FASTEST_MM_S:g}" in answer["message"]
    assert stands_still(world)


@pytest.mark.parametrize("name", ["speed_mm_s", "grasp_speed_mm_s"])
def test_nor_may_it_be_the_default(name: str) -> None:
    client = World().enabled()
    beyond = {name: FASTEST_MM_S + 1.0}
    assert client.refusal("config.set", config=beyond) == "invalid_params"
    assert client.result("config.set", config={name: FASTEST_MM_S})


@every_motion
def test_a_small_scale_lowers_the_bound_and_the_refusal_names_it(
    method: str, params: dict[str, Any]
) -> None:
    world, client = scaled(SMALL_MM_RAD)
    most_mm_s = DM4310.fastest_rad_s * SMALL_MM_RAD
    answer = client.call(method, **params, speed_mm_s=most_mm_s + 0.5)["error"]
    assert answer["data"]["reason"] == "out_of_limits"
    assert answer["data"]["field"] == "speed_mm_s"
    assert answer["data"]["limit"] == pytest.approx(most_mm_s)
    assert f"{DM4310.fastest_rad_s:g} rad/s" in answer["message"]
    assert "20 mm/rad" in answer["message"]
    assert stands_still(world)
    assert "result" in client.call(method, **params, speed_mm_s=most_mm_s - 0.5)


@pytest.mark.parametrize(
    ("method", "name"),
    [("motion.open", "speed_mm_s"), ("motion.grasp", "grasp_speed_mm_s")],
)
def test_a_default_that_is_too_fast_for_the_scale_is_refused_by_its_name(
    method: str, name: str
) -> None:
    world, client = scaled(SMALL_MM_RAD)
    answer = client.call(method, config={name: 100.0})["error"]
    assert (answer["data"]["reason"], answer["data"]["field"]) == ("out_of_limits", name)
    assert stands_still(world)


def test_a_time_that_is_too_short_is_refused_or_becomes_the_shortest() -> None:
    world, client = scaled(SMALL_MM_RAD)
    answer = client.call("motion.move", openness=0.0, duration_s=0.1)["error"]
    assert (answer["data"]["reason"], answer["data"]["field"]) == ("out_of_limits", "duration_s")
    assert stands_still(world)
    number = client.send("motion.move", openness=0.1, at_least_s=0.1)
    fastest_rad_s = max(client.track(number, lambda: abs(world.gripper.velocity_rad_s)))
    assert client.answers[number]["result"]["outcome"] == "reached"
    assert fastest_rad_s <= OVERSHOOT * DM4310.fastest_rad_s


@pytest.mark.parametrize("rad_to_mm", [0.001, SMALL_MM_RAD, 46.7, 52.69, 74.8, 1e6])
@pytest.mark.parametrize("motor_type", [DM4310, replace(DM4310, rated_speed_rad_s=1.5)])
def test_the_bound_is_the_lower_of_both(rad_to_mm: float, motor_type: MotorType) -> None:
    geometry = replace(NOMINAL[0], rad_to_mm=rad_to_mm)
    bound_mm_s = fastest_mm_s(geometry, motor_type)
    assert bound_mm_s <= FASTEST_MM_S
    assert bound_mm_s / rad_to_mm <= motor_type.fastest_rad_s * (1.0 + 1e-12)
    assert bound_mm_s in (FASTEST_MM_S, motor_type.fastest_rad_s * rad_to_mm)


@pytest.mark.parametrize("motor_type", [DM4310, replace(DM4310, rated_speed_rad_s=1.5)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_limiter_lets_no_command_be_faster(motor_type: MotorType, sign: float) -> None:
    limiter = CommandLimiter(motor_type)
    feedback = Feedback(1, -0.8, 0.0, 0.0, 30, 30, 0.0)
    bounds = bounds_of(NOMINAL[0], MotionConfig())
    most_rad_s = motor_type.fastest_rad_s
    for asked_rad_s in (most_rad_s, 1.01 * most_rad_s, 20.0):
        wanted = MitCommand(-0.8, sign * asked_rad_s, 10.0, 0.1, 0.0)
        sent, limited = limiter.apply(0.0, wanted, feedback, bounds, motor_type.ranges)
        assert sent.velocity_rad_s == sign * most_rad_s
        assert ("speed" in limited) == (asked_rad_s > most_rad_s)
        assert sent.position_rad == wanted.position_rad


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
@pytest.mark.parametrize("lead_mm", [0.5, 0.7, 0.8, 1.0])
def test_a_small_lead_is_no_reason_to_refuse_a_speed(
    method: str, rate_hz: int, lead_mm: float
) -> None:
    """At 100 Hz the jaws travel 1.5 mm in a period: a lead grows to what they need at a speed."""
    world, client = ready(period_s=1.0 / rate_hz)
    client.result("motion.open" if method == "motion.close" else "motion.close")
    config = {"max_lead_mm": lead_mm, "stop_lead_mm": min(lead_mm, 0.7)}
    number = client.send(method, speed_mm_s=150.0, config=config)
    fastest_rad_s = max(client.track(number, lambda: abs(world.gripper.velocity_rad_s)))
    assert client.answers[number]["result"]["outcome"] == "pressed_home"
    assert fastest_rad_s * NOMINAL[0].rad_to_mm > 0.9 * 150.0
    assert fastest_rad_s < OVERSHOOT * DM4310.fastest_rad_s


def test_a_small_lead_stays_that_of_a_slow_motion() -> None:
    config = MotionConfig(max_lead_mm=0.7, stop_lead_mm=0.7)
    assert config.travel_nm_at(5.0) == config.travel_nm_at(50.0) == config.travel_nm
    assert config.travel_nm_at(FASTEST_MM_S) == MotionConfig().travel_nm_at(5.0) == MOST_PUSH_NM


def test_a_lead_is_at_least_the_travel_of_a_period() -> None:
    push_nm, speed_rad_s, period_s = 0.94, DM4310.fastest_rad_s, 0.01
    gains, lead_rad = lead_within(push_nm, DEFAULT_GAINS, speed_rad_s, period_s)
    assert lead_rad >= speed_rad_s * period_s
    assert gains.kp_nm_rad * lead_rad == pytest.approx(push_nm)
