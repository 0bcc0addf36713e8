"""A file's work stroke: how far `open` goes, as a plain move that never meets the stop."""

import json
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from litegripd.io.helper.files import DATA
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.model.motor import MotorPhase
from litegripd.sim.plant import limits_of_mount
from tests.app.test_facts import info
from tests.world import Client, World

MOUNTS = ("normal", "reverse")
WORK_MM, TRAVEL_MM, MM_RAD = 80.0, NOMINAL[0].travel_mm, NOMINAL[0].rad_to_mm
REACH_MM = 0.02 * MM_RAD
"""`reach_tol`."""


def gripper(
    opening_mm: float = 30.0,
    mount: str = "normal",
    work_mm: float = WORK_MM,
    kp_nm_rad: float | None = None,
    kd_nm_s_rad: float | None = None,
) -> tuple[World, Client]:
    world = World(mount, initial_opening_mm=opening_mm)
    file = Calibration(
        world.geometry, kp_nm_rad=kp_nm_rad, kd_nm_s_rad=kd_nm_s_rad, work_stroke_mm=work_mm
    )
    world.controller.use_calibration(file)
    return world, world.enabled()


def opened(world: World, client: Client, **params: Any) -> tuple[dict[str, Any], float]:
    """Open; return the result, and the widest opening meanwhile."""
    number = client.send("motion.open", **params)
    widest_mm = max(client.track(number, lambda: world.gripper.opening_mm))
    result: dict[str, Any] = client.answers[number]["result"]
    return result, widest_mm


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("speed_mm_s", [10.0, 50.0, FASTEST_MM_S])
def test_open_ends_there_and_never_nearer_the_stop(mount: str, speed_mm_s: float) -> None:
    world, client = gripper(mount=mount)
    result, widest_mm = opened(world, client, speed_mm_s=speed_mm_s)
    assert (result["ok"], result["outcome"]) == (True, "reached")
    assert (result["reached"], result["stalled"], result["protected"]) == (True, False, False)
    closed_rad, open_rad = limits_of_mount(mount)
    assert result["limit_rad"] == open_rad
    assert abs(result["target_rad"] - closed_rad) * MM_RAD == pytest.approx(WORK_MM)
    assert world.gripper.opening_mm == pytest.approx(WORK_MM, abs=REACH_MM)
    assert widest_mm < WORK_MM + REACH_MM
    world.run(0.5)
    assert world.state.mode == "holding"
    assert world.torque_nm < 0.3  # it presses on nothing


@pytest.mark.parametrize(("kp_nm_rad", "kd_nm_s_rad"), [(5.0, 2.0), (5.0, 0.05), (500.0, 1.0)])
def test_with_any_gains_of_the_file(kp_nm_rad: float, kd_nm_s_rad: float) -> None:
    world, client = gripper(kp_nm_rad=kp_nm_rad, kd_nm_s_rad=kd_nm_s_rad)
    for _ in range(2):
        result, widest_mm = opened(world, client)
        assert result["outcome"] == "reached"
        assert world.gripper.opening_mm == pytest.approx(WORK_MM, abs=REACH_MM)
        assert widest_mm < WORK_MM + REACH_MM
        assert client.result("motion.close")["outcome"] == "pressed_home"


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("opening_mm", [TRAVEL_MM, 84.0])
def test_jaws_that_are_wider_close_to_it(mount: str, opening_mm: float) -> None:
    world, client = gripper(opening_mm, mount)
    result, _ = opened(world, client)
    assert (result["ok"], result["outcome"]) == (True, "reached")
    assert result["limit_rad"] == limits_of_mount(mount)[1]
    assert world.gripper.opening_mm == pytest.approx(WORK_MM, abs=REACH_MM)


def test_a_move_and_a_stream_may_go_beyond_it() -> None:
    world, client = gripper()
    assert client.result("motion.move", opening_mm=86.0)["outcome"] == "reached"
    assert world.gripper.opening_mm == pytest.approx(86.0, abs=REACH_MM)
    assert client.result("motion.move", openness=1.0)["outcome"] == "reached"
    assert world.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=REACH_MM)
    client.result("motion.move", opening_mm=70.0)
    for _ in range(20):
        client.send("stream.set", opening_mm=85.0)
        world.run(0.05)
    assert world.gripper.opening_mm == pytest.approx(85.0, abs=REACH_MM)


@pytest.mark.parametrize("work_mm", [0.0, TRAVEL_MM, 120.0])
def test_none_or_one_beyond_the_travel_opens_to_the_stop(work_mm: float) -> None:
    world, client = gripper(work_mm=work_mm)
    assert world.state.work_stroke_mm is None
    assert client.result("calibration.get")["work_stroke_mm"] is None
    result, _ = opened(world, client)
    assert result["outcome"] == "pressed_home"
    assert world.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=1.0)


def test_state_and_calibration_say_it() -> None:
    world, client = gripper()
    assert world.state.work_stroke_mm == WORK_MM
    assert client.result("calibration.get")["work_stroke_mm"] == WORK_MM
    world.controller.use_calibration(None)
    assert world.state.work_stroke_mm is None


def test_what_is_held_is_let_go() -> None:
    world, client = gripper(60.0)
    world.gripper.put_object(width_mm=40.0)
    assert client.result("motion.grasp", force_n=20.0, until="verdict")["outcome"] == "object_held"
    world.run(1.0)
    result, _ = opened(world, client)
    assert result["outcome"] == "reached"
    assert world.gripper.opening_mm == pytest.approx(WORK_MM, abs=REACH_MM)
    assert not world.state.is_grasped


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(("work_mm", "width_mm"), [(40.0, 60.0), (WORK_MM, 82.0)])
def test_what_is_held_and_wider_is_let_go_and_not_squeezed(
    mount: str, work_mm: float, width_mm: float
) -> None:
    world, client = gripper(84.0, mount, work_mm)
    world.gripper.put_object(width_mm=width_mm)
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["outcome"] == "object_held"
    world.run(0.5)
    number = client.send("motion.open")
    assert max(client.track(number, lambda: world.squeeze_nm)) < 1.1
    assert client.answers[number]["result"]["outcome"] == "reached"
    assert world.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=REACH_MM)


def test_what_is_in_the_way_blocks_it() -> None:
    """Something holds the jaws: the command leads no further than a move's."""
    world, client = gripper()
    world.gripper.jam()
    result, widest_mm = opened(world, client)
    assert (result["ok"], result["outcome"], result["stalled"]) == (False, "blocked", True)
    assert widest_mm < 32.0


def test_a_stop_and_another_client_are_heeded_as_ever() -> None:
    world, client = gripper()
    number = client.send("motion.open")
    world.run(0.2)
    assert world.state.job is not None
    assert world.state.job.kind == "open"
    assert world.client().refusal("motion.open") == "busy"
    world.client().result("stop")
    assert client.wait(number)["error"]["data"]["reason"] == "stopped"
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.gripper.opening_mm < 50.0


def test_a_speed_that_is_too_slow_or_too_fast_is_refused_as_ever() -> None:
    _, client = gripper()
    assert client.refusal("motion.open", speed_mm_s=0.1) == "out_of_limits"
    assert client.refusal("motion.open", speed_mm_s=151.0) == "invalid_params"


def test_a_measurement_keeps_it() -> None:
    world, client = gripper()
    result = client.result("calibration.zero")
    assert result["content"]["work_stroke_mm"] == WORK_MM
    assert world.disk.saved["calibration.save"]["content"]["work_stroke_mm"] == WORK_MM
    assert opened(world, client)[0]["outcome"] == "reached"


def test_it_opens_without_a_jump() -> None:
    world, client = gripper()
    since_s = world.now_s
    opened(world, client)
    commands = [command for _, command in world.commands_since(since_s)]
    most_rad = NOMINAL[0].to_rad(50.0) * world.period_s + 2 * 25.0 / 65535
    for before, later in pairwise(commands[2:-5]):
        assert abs(later.position_rad - before.position_rad) <= most_rad


def test_one_beyond_the_travel_is_named_to_who_loads_it_and_where_somebody_looks() -> None:
    world, client = gripper(work_mm=TRAVEL_MM + 1.0)
    (said,) = client.result("calibration.get")["warnings"]
    assert f"work_stroke_mm is {TRAVEL_MM + 1.0:g}, beyond the 87.0 mm of travel" in said
    assert info(world)["calibration"]["work_stroke"] == said
    content = {"zero_position_rad": 0.0, "max_position_rad": -1.65, "rad_to_mm": 52.69}
    answer = client.result("calibration.load", content={**content, "work_stroke_mm": 1e39})
    assert any("work_stroke_mm is 1e+39, beyond the 86.9 mm" in one for one in answer["warnings"])
    answer = client.result("calibration.load", content={**content, "work_stroke_mm": 86.0})
    assert answer["warnings"] == []
    assert info(world)["calibration"]["work_stroke"] is None


def test_a_stroke_that_is_configured_below_a_templates_work_stroke_is_named() -> None:
    world, client = gripper()
    world.controller.gripper_id = replace(world.controller.gripper_id, stroke_mm=60.0)
    answer = client.result("calibration.load", content=template_content())
    assert answer["travel_mm"] == pytest.approx(61.0)
    assert any(
        "work_stroke_mm is 80, beyond the 61.0 mm of travel" in one for one in answer["warnings"]
    )


def template_content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads((DATA / "normal.json").read_text(encoding="utf-8"))
    return content
