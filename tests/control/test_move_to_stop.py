"""Opening and closing on the simulated gripper, and what is commanded on the way."""

import math

import pytest

from litegripd.control.limiter import LEAD_PERIODS
from litegripd.control.motions.move import SPEED_UP_S
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import FASTEST_MM_S, Geometry
from litegripd.model.motion_config import MOVING_KP_NM_RAD, MotionConfig
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.world import PERIOD_S, Client, World, ready

MOUNTS = ("normal", "reverse")
CONFIG, MM_RAD, TRAVEL_MM = MotionConfig(), NOMINAL[0].rad_to_mm, NOMINAL[0].travel_mm
LEAD_RAD, PRESS_RAD = CONFIG.travel_nm / MOVING_KP_NM_RAD, CONFIG.stop_nm / MOVING_KP_NM_RAD
RUN_IN_RAD = 1.1 * PRESS_RAD  # near the stop, until the jaws are home
FAR_RAD = 0.5  # so far that the jaws do not get where they stick in front of the true stop
CODE_RAD = 25.0 / 65535
SLOWEST_MM_S = (
    1.005
    * CONFIG.stop_nm
    / MOVING_KP_NM_RAD
    * MM_RAD
    / (CONFIG.stall_cycles * CONFIG.sample_interval)
)


def calibrate(world: World, closed_by: float = 0.0, open_by: float = 0.0) -> None:
    """Shift the calibrated limits by shares of the travel, outwards positive."""
    closed_rad, open_rad = limits_of_mount("normal")
    travel_rad = closed_rad - open_rad
    geometry = Geometry(
        closed_rad + closed_by * travel_rad, open_rad - open_by * travel_rad, MM_RAD
    )
    world.controller.use_calibration(Calibration(geometry), None)


def record(
    world: World, client: Client, method: str, **params: object
) -> list[tuple[float, float]]:
    """Run a motion; return (measured position, commanded position) of every tick of it."""
    number = client.send(method, **params)
    seen = []
    while not client.has_answer(number):
        world.tick()
        commands = world.commands_since(world.now_s)
        measured = world.controller.motor.feedback
        if commands and measured is not None and world.controller.jobs.running is not None:
            seen.append((measured.position_rad, commands[-1][1].position_rad))
    return seen


def blocked_world(width_mm: float, **item: float) -> tuple[World, Client]:
    world = World(initial_opening_mm=80.0)
    world.gripper.put_object(width_mm=width_mm, **item)
    return world, world.enabled()


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
def test_the_target_lies_past_the_stop_and_the_stop_ends_the_move(mount: str, method: str) -> None:
    world = World(mount)
    result = world.enabled().result(method)
    closed_rad, open_rad = limits_of_mount(mount)
    limit_rad, other_rad = (
        (closed_rad, open_rad) if method == "motion.close" else (open_rad, closed_rad)
    )
    assert result["limit_rad"] == limit_rad
    assert result["target_rad"] == pytest.approx(limit_rad + 0.05 * (limit_rad - other_rad))
    assert (result["ok"], result["stalled"], result["reached"]) == (True, True, False)
    assert result["outcome"] == "pressed_home"
    assert result["state"]["mount"] == mount
    assert abs(world.gripper.position_rad - limit_rad) < 0.02


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
@pytest.mark.parametrize("speed", [20.0, 50.0, 120.0])
def test_the_commands_lead_stays_within_two_tiers_in_every_phase(
    mount: str, method: str, speed: float
) -> None:
    world, client = ready(mount)
    client.result("motion.open" if method == "motion.close" else "motion.close")
    seen = record(world, client, method, speed_mm_s=speed)
    geometry = world.geometry
    limit_rad = geometry.closed_rad if method == "motion.close" else geometry.open_rad
    towards = math.copysign(1.0, limit_rad - seen[0][0])
    fast_rad = LEAD_PERIODS * speed / MM_RAD * PERIOD_S  # softer, with the same torque
    pressing = 0
    for position_rad, command_rad in seen:
        short_mm = (limit_rad - position_rad) * towards * MM_RAD
        allowed_rad = PRESS_RAD if short_mm <= CONFIG.stop_tol * MM_RAD else RUN_IN_RAD
        allowed_rad = allowed_rad if short_mm <= 2.0 else max(LEAD_RAD, fast_rad)
        pressing += short_mm <= 2.0
        assert abs(command_rad - position_rad) <= allowed_rad + CODE_RAD
    assert pressing > 0.3 / PERIOD_S  # the settle phase is among them


@pytest.mark.parametrize("mount", MOUNTS)
def test_it_presses_with_about_what_the_stop_lead_means(mount: str) -> None:
    world, client = ready(mount)
    torques = client.track(client.send("motion.close"), lambda: world.torque_nm)
    assert torques[-10] == pytest.approx(CONFIG.stop_nm, abs=0.08)
    assert max(torques) < 2.0


def test_after_the_move_the_jaws_are_held_where_they_are() -> None:
    world, client = ready()
    client.result("motion.close")
    world.run(0.5)
    position_rad = world.state.position_rad
    assert position_rad is not None
    assert world.state.mode == "holding"
    assert abs((world.state.command_rad or 0.0) - position_rad) < 0.01
    assert world.torque_nm < 1.0


def test_an_object_far_from_the_stop_blocks_the_move() -> None:
    world, client = blocked_world(50.0)
    config = {"stop_torque_cycles": 100}  # so late that the stall comes first
    result = client.result("motion.close", config=config)
    assert (result["ok"], result["outcome"], result["stalled"]) == (False, "blocked", True)
    assert not result["protected"]
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=3.0)


def test_a_blocked_move_ends_within_a_stall_window_and_never_leads_more_than_allowed() -> None:
    world, client = blocked_world(50.0)
    number = client.send("motion.close")
    world.run_until(lambda: world.gripper.opening_mm < 51.0)
    touched_s = world.now_s
    client.wait(number)
    assert world.now_s - touched_s < 0.5
    assert world.torque_nm <= CONFIG.travel_nm * 1.05


@pytest.mark.parametrize("share", [-0.008, 0.008, 0.02, 0.03])
def test_a_calibration_that_is_slightly_off_is_still_pressed_home(share: float) -> None:
    """Negative: the calibrated stop lies before the real one; positive: behind it."""
    world = World()
    calibrate(world, closed_by=-share, open_by=-share)
    client = world.enabled()
    for method, opening_mm in (("motion.open", TRAVEL_MM), ("motion.close", 0.0)):
        result = client.result(method)
        assert (result["ok"], result["outcome"]) == (True, "pressed_home")
        assert world.gripper.opening_mm == pytest.approx(opening_mm, abs=1.0)


def test_a_calibration_that_is_far_too_wide_is_no_success() -> None:
    world = World()
    calibrate(world, closed_by=0.05)
    result = world.enabled().result("motion.close")
    assert (result["ok"], result["outcome"]) == (False, "protected")


def test_a_stop_that_is_not_there_is_no_success() -> None:
    world = World()
    calibrate(world, closed_by=-0.3)
    result = world.enabled().result("motion.close")
    assert (result["ok"], result["outcome"]) == (False, "no_stop")
    assert (result["reached"], result["stalled"]) == (True, False)


@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
def test_a_move_that_starts_on_its_stop_presses_home_at_once(method: str) -> None:
    world, client = ready()
    client.result(method)
    began_s = world.now_s
    assert client.result(method)["outcome"] == "pressed_home"
    assert world.now_s - began_s < 1.0


@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
@pytest.mark.parametrize("speed", [SLOWEST_MM_S, FASTEST_MM_S])
def test_the_slowest_and_the_fastest_speed_press_home(method: str, speed: float) -> None:
    """Static friction must not look like a stall, nor the cap clip the ramp's own step."""
    _world, client = ready(initial_opening_mm=60.0)
    answer = client.call(method, within_s=60.0, speed_mm_s=speed)
    assert answer["result"]["outcome"] == "pressed_home"


@pytest.mark.parametrize("speed", [0.1, 0.95 * SLOWEST_MM_S])
def test_speeds_that_do_not_go_with_the_settings_are_refused(speed: float) -> None:
    client = World().enabled()
    error = client.call("motion.open", speed_mm_s=speed)["error"]
    assert error["data"]["reason"] == "out_of_limits"
    assert error["data"]["requested"] == speed
    assert "speed_mm_s" in error["message"]


def test_a_calibration_file_of_a_gripper_that_never_was_calibrated_does_not_count() -> None:
    world = World()
    geometry = world.geometry
    world.controller.use_calibration(Calibration(geometry, calibrated=False), None)
    assert world.enabled().refusal("motion.open") == "not_calibrated"


def test_progress_tells_where_the_move_is() -> None:
    _world, client = ready()
    number = client.send("motion.close", progress=True)
    client.wait(number)
    reports = client.told("job.progress")
    phases = [report["phase"] for report in reports]
    assert sorted(set(phases), key=phases.index) == ["ramp", "press", "settle"]
    steps = [report["step"] for report in reports]
    assert steps == sorted(steps)
    total = reports[0]["total_steps"]
    assert total == pytest.approx(
        ((60.0 + 0.05 * TRAVEL_MM) / 50.0 + 0.5 * SPEED_UP_S) / PERIOD_S, abs=2
    )
    assert all(report["total_steps"] == total and report["step"] <= total for report in reports)
    assert reports[0]["opening_mm"] > reports[-1]["opening_mm"]
    assert {report["request"] for report in reports} == {number}


@pytest.mark.parametrize("press_overshoot", [0.05, 0.1, 0.2])
def test_a_target_further_past_the_stop_is_not_mistaken_for_one(press_overshoot: float) -> None:
    """What bounds the command is the call's own configuration, not the daemon's."""
    world = World(
        parameters=SimulatorParameters(closed_rad=NOMINAL[0].closed_rad + FAR_RAD), calibrated=False
    )
    world.controller.use_calibration(Calibration(NOMINAL[0]), None)
    client = world.enabled()
    closed = client.result("motion.close", config={"press_overshoot": press_overshoot})
    assert (closed["ok"], closed["outcome"]) == (False, "no_stop")
