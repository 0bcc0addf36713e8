"""Every type of motor through the whole daemon: it grips, and nothing goes beyond its row."""

from dataclasses import replace
from typing import Any

import pytest

from litegrip_client.values.trajectory_format import MOST_FORCE_N
from litegripd.control.limiter import torque_bound_nm
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import (
    DM4310,
    DM4340,
    FASTEST_MM_S,
    MOTOR_TYPES,
    NM_TO_N_RANGE,
    MotorType,
)
from litegripd.model.motor import MotorPhase
from tests.control.exchange import exchange
from tests.world import Client, World, ready

BETWEEN = replace(
    DM4340,
    name="between",
    ranges=replace(DM4310.ranges, velocity_rad_s=20.0, torque_nm=18.0),
    gear_ratio=20.0,
    rated_nm=6.0,
    holding_nm=6.0,
    peak_nm=14.0,
    no_load_speed_rad_s=10.4,
    rated_speed_rad_s=6.3,
    rotor_inertia_kg_m2=7.2e-3,
    torque_constant_nm_a=1.89,
    braking_nm_s_rad=2.8,
)
"""A type that no table has: nothing of the daemon knows types but by their rows."""

TYPES: dict[str, MotorType] = {**MOTOR_TYPES, BETWEEN.name: BETWEEN}
every_type = pytest.mark.parametrize("motor_type", TYPES.values(), ids=TYPES)
every_mount = pytest.mark.parametrize("mount", ["normal", "reverse"])


def gripping(
    motor_type: MotorType, mount: str, force_n: float, **more: Any
) -> tuple[World, Client]:
    """Let the jaws open, close on an object of 40 mm and hold it."""
    world, client = ready(mount, motor_type=motor_type, **more)
    assert client.result("motion.open")["outcome"] == "pressed_home"
    world.gripper.put_object(width_mm=40.0)
    answer = client.result("motion.grasp", force_n=force_n, until="verdict")
    assert answer["outcome"] == "object_held"
    assert answer["width_mm"] == pytest.approx(40.0, abs=1.5)
    return world, client


@every_mount
@every_type
def test_it_opens_grips_holds_notices_a_loss_and_closes(motor_type: MotorType, mount: str) -> None:
    world, client = gripping(motor_type, mount, 20.0)
    world.run(2.0)
    hidden_n = 10.0 * 1.6 * motor_type.breakaway_nm
    assert 10.0 * world.gripper.clamp_nm == pytest.approx(20.0, abs=hidden_n)
    assert world.state.is_grasped
    world.gripper.remove_object()
    world.run_until(lambda: not world.state.is_grasped, 0.3)
    assert client.result("motion.close")["outcome"] == "pressed_home"
    sent = world.commands_since(0.0)
    assert max(abs(command.torque_nm) for _, command in sent) <= motor_type.rated_nm


@every_type
def test_it_stops_slack_and_disabled(motor_type: MotorType) -> None:
    world, client = gripping(motor_type, "normal", 20.0)
    held_mm = world.gripper.opening_mm
    client.result("stop", level="hold")
    world.run(1.0)
    assert world.gripper.opening_mm == pytest.approx(held_mm, abs=0.5)
    client.result("stop", level="relax")
    world.run(0.5)
    smallest_nm = 1.01 * motor_type.ranges.torque_nm / 4095
    assert world.torque_nm <= smallest_nm
    client.result("stop", level="disable")
    world.run_until(lambda: world.phase is MotorPhase.DISABLED, 1.0)
    assert client.refusal("motion.open") == "stopped"


@every_type
def test_the_most_that_may_be_asked_for_follows_from_the_row(motor_type: MotorType) -> None:
    client = World(motor_type=motor_type).enabled()
    ranges = client.result("config.get")["ranges"]
    most = {
        "force_n": min(10.0 * motor_type.holding_nm, MOST_FORCE_N),
        "stop_torque_nm": motor_type.peak_nm,
        "calib_tau_limit": motor_type.rated_nm,
        "speed_mm_s": FASTEST_MM_S,
    }
    assert {name: ranges[name][1] for name in most} == pytest.approx(most)
    described = {
        (method["name"], param["name"]): param["schema"].get("maximum")
        for method in client.result("rpc.discover")["methods"]
        for param in method["params"]
    }
    for method, name, limit in (
        ("motion.set_force", "force_n", most["force_n"]),
        ("motion.open", "speed_mm_s", most["speed_mm_s"]),
        ("stream.set", "torque_nm", motor_type.rated_nm),
        ("teleop.start", "dq_max", motor_type.ranges.velocity_rad_s),
        ("teleop.start", "torque_limit_nm", motor_type.ranges.torque_nm),
    ):
        assert described[method, name] == pytest.approx(limit)
    beyond = 1.01 * most["force_n"]
    for asked in ({"force_n": beyond}, {"config": {"force_n": beyond}}):
        answer = client.call("motion.grasp", **asked)["error"]
        assert answer["data"]["reason"] == "invalid_params"
        assert f"0.5 to {most['force_n']:g}" in answer["message"]


def most_squeezing(motor_type: MotorType, ambient_c: float = 25.0) -> tuple[World, float]:
    """Return a gripper in whose file a newton is as much torque as the type can give for 40 N."""
    world = World(motor_type=motor_type, ambient_c=ambient_c)
    least, _ = NM_TO_N_RANGE
    nm_to_n = max(motor_type.most_force_n / motor_type.holding_nm, least)
    geometry = replace(NOMINAL[0], nm_to_n=nm_to_n)
    world.controller.use_calibration(Calibration(geometry))
    return world, nm_to_n


@every_type
def test_what_a_type_bears_for_long_can_be_asked_for(motor_type: MotorType) -> None:
    rate = {"config": {"force_rate_n_s": 200.0}}
    world, nm_to_n = most_squeezing(motor_type)
    client = world.enabled()
    world.gripper.put_object(width_mm=50.0)
    most_n = motor_type.most_force_n
    assert client.result("motion.grasp", force_n=most_n, until="verdict", **rate)["ok"]
    world.run(1.0)
    assert world.torque_nm == pytest.approx(most_n / nm_to_n, rel=0.02)
    assert world.state.limited == ()


@every_type
def test_no_command_asks_for_more_than_the_peak_and_that_only_for_a_moment(
    motor_type: MotorType,
) -> None:
    """Stiff jaws hold a place that they are pushed away from."""
    world, client = ready(motor_type=motor_type)
    world.controller.calibrated.gains = replace(world.controller.gains, kp_nm_rad=500.0)
    client.result("motion.hold")
    world.gripper.push(-2.0 * motor_type.peak_nm)
    since_s, impulse_nm_s, asked = world.now_s, 0.0, []
    most_nm_s = motor_type.peak_impulse_nm_s + 2.0 * world.period_s * motor_type.peak_nm
    while world.now_s < since_s + 4.0:
        world.tick()
        feedback, command = world.controller.motor.feedback, world.controller.output.command
        assert feedback is not None
        asked.append(0.0 if command is None else torque_bound_nm(command, feedback))
        above_nm_s = (asked[-1] - motor_type.rated_nm) * world.period_s
        impulse_nm_s = max(impulse_nm_s + above_nm_s, 0.0)
        assert impulse_nm_s <= most_nm_s
    assert max(asked) == pytest.approx(motor_type.peak_nm, rel=1e-3)


@pytest.mark.parametrize("motor_type", MOTOR_TYPES.values(), ids=MOTOR_TYPES)
def test_a_hot_coil_is_kept_below_its_limit(motor_type: MotorType) -> None:
    """In a room so hot that the rated torque would pass it."""
    world, _ = most_squeezing(motor_type, ambient_c=72.0)
    client = world.enabled()
    world.gripper.put_object(width_mm=50.0)
    most_n, rate = motor_type.most_force_n, {"force_rate_n_s": 200.0}
    client.result("motion.grasp", force_n=most_n, until="verdict", config=rate)
    hottest_c = 0.0
    for _ in range(50):
        world.run(1.0)
        hottest_c = max(hottest_c, world.gripper.motor.coil_c)
    assert motor_type.coil_limit_c - 1.0 < hottest_c < motor_type.coil_limit_c + 1.5
    assert world.state.limited == ("heat",)
    assert world.state.is_grasped


@every_type
def test_a_successor_goes_on_with_the_same_motor(motor_type: MotorType) -> None:
    most_n = motor_type.most_force_n
    world, _ = gripping(motor_type, "normal", 20.0)
    exchange(world)
    client = world.client()
    assert client.result("motion.set_force", force_n=most_n)["force_n"] == most_n
    world.run(most_n / 20.0)
    assert world.state.is_grasped
    assert world.torque_nm == pytest.approx(most_n / 10.0, rel=0.05)


@every_type
def test_what_it_calibrates_names_its_type(motor_type: MotorType) -> None:
    world, client = ready(motor_type=motor_type)
    assert client.result("calibration.zero", within_s=60.0)["ok"]
    assert world.disk.saved["calibration.save"]["content"]["motor_type"] == motor_type.name
