"""Grasps on the simulated gripper: verdicts, the hold, and how each may end."""

from functools import partial
from itertools import pairwise
from statistics import fmean
from typing import Any

import pytest

from litegripd.model.errors import at_most
from litegripd.sim.plant import MOUNTS
from tests.world import Client, World, ready

FORCE_CODE_NM = 0.05  # a code of torque, and one of velocity under the damping of a hold


def world_with(
    width_mm: float | None, mount: str = "normal", **item: float
) -> tuple[World, Client]:
    opening_mm = 100.0 if width_mm is None else min(width_mm + 20.0, 115.0)
    world = World(mount, initial_opening_mm=opening_mm)
    if width_mm is not None:
        world.gripper.put_object(width_mm=width_mm, **item)
    return world, world.enabled()


def kinds(world: World) -> list[str]:
    """Return the kinds of the events since the last call."""
    seen: list[str] = []
    while events := world.service.take_events():
        seen += [event.kind for event in events]
    return seen


def grasped(client: Client, **params: Any) -> dict[str, Any]:
    return client.result("motion.grasp", until="verdict", **params)


@pytest.mark.parametrize("mount", MOUNTS)
def test_an_object_is_held_with_the_set_force(mount: str) -> None:
    world, client = world_with(50.0, mount)
    result = grasped(client, force_n=15)
    assert (result["ok"], result["outcome"]) == (True, "object_held")
    assert (result["stalled"], result["reached"]) == (True, False)
    assert result["width_mm"] == pytest.approx(50.0, abs=1.0)
    assert result["force_n"] == 15
    world.run(1.0)
    assert world.squeeze_nm == pytest.approx(1.5, abs=FORCE_CODE_NM)
    assert world.state.is_grasped
    assert world.state.force_set_n == 15
    assert world.state.mode == "holding"


@pytest.mark.parametrize("force_n", [3.0, 10.0, 20.0, 30.0])
@pytest.mark.parametrize(("mount", "stiffness_nm_rad"), [("normal", 250.0), ("reverse", 30.0)])
@pytest.mark.parametrize("after_s", [0.0, 0.005, 0.01, 0.05, 0.2, 1.0])
def test_what_a_motion_has_pressed_is_held_though_it_pushes_the_jaws_back(
    mount: str, stiffness_nm_rad: float, after_s: float, force_n: float
) -> None:
    """It was "timed_out", after 3.4 s, while the jaws held it."""
    world, client = world_with(40.0, mount, stiffness_nm_rad=stiffness_nm_rad)
    assert client.result("motion.move", opening_mm=5.0)["outcome"] == "blocked"
    world.run(after_s)
    began_s = world.now_s
    result = grasped(client, force_n=force_n)
    assert (result["ok"], result["outcome"], result["force_n"]) == (True, "object_held", force_n)
    assert world.now_s - began_s < 0.6
    world.run(1.0)
    assert world.squeeze_nm == pytest.approx(force_n / 10.0, abs=0.3)


@pytest.mark.parametrize("margin", [0.0, 0.5, 0.95])
def test_a_grasp_goes_no_further_than_its_margin(margin: float) -> None:
    world, client = world_with(None)
    client.result("motion.open")
    result = grasped(client, config={"margin": margin})
    assert (result["outcome"], result["reached"]) == ("no_object", True)
    openness = world.state.openness
    assert openness == pytest.approx(margin, abs=0.013)
    at_mm = world.gripper.opening_mm
    client.result("motion.open")
    world.gripper.put_object(width_mm=at_mm + 2.5)
    assert grasped(client, config={"margin": margin})["outcome"] == "object_held"


@pytest.mark.parametrize("mount", MOUNTS)
def test_nothing_between_the_jaws_is_no_success_and_nothing_is_squeezed(mount: str) -> None:
    world, client = world_with(None, mount)
    result = client.result("motion.grasp")  # also where the hold would be for ever
    assert (result["ok"], result["outcome"]) == (False, "no_object")
    assert (result["stalled"], result["reached"]) == (False, True)
    assert (result["width_mm"], result["cycles"]) == (None, 0)
    assert abs(world.gripper.position_rad - result["target_rad"]) <= 0.02
    world.run(0.5)
    assert world.torque_nm < 0.3
    assert (world.state.is_grasped, world.state.force_set_n) == (False, None)


def test_the_force_rises_from_the_torque_in_flight_at_its_rate() -> None:
    world, client = world_with(50.0)
    grasped(client, force_n=20, config={"force_rate_n_s": 10})
    began_s = world.now_s
    seen = []
    for _ in range(60):
        world.run(0.02)
        seen.append((world.now_s - began_s, world.commands_since(world.now_s)[-1][1].torque_nm))
    assert 0.5 < seen[0][1] < 1.2
    steps = [later[1] - earlier[1] for earlier, later in pairwise(seen)]
    assert max(steps) <= 0.02 + 0.006  # 1 N·m/s for 20 ms, and a code
    assert seen[-1][1] == pytest.approx(2.0, abs=0.01)


def test_hold_s_ends_the_call_but_not_the_hold() -> None:
    world, client = world_with(50.0)
    result = client.result("motion.grasp", force_n=10, hold_s=1.5)
    assert result["outcome"] == "object_held"
    assert result["held_s"] == pytest.approx(1.5, abs=0.01)
    assert result["cycles"] == 7  # of 0.2 s
    world.run(2.0)
    assert world.squeeze_nm == pytest.approx(1.0, abs=FORCE_CODE_NM)
    assert world.state.is_grasped
    assert client.result("motion.open")["ok"]
    assert not world.state.is_grasped


def test_a_hold_for_ever_lasts_until_it_is_cancelled_and_then_goes_on() -> None:
    world, client = world_with(50.0)
    number = client.send("motion.grasp", force_n=10)
    world.run(10.0)
    assert not client.has_answer(number)
    job = world.running
    other = world.client()
    other.result("job.cancel", job=job.number)
    assert client.wait(number, 0.1)["error"]["data"]["reason"] == "cancelled"
    world.run(1.0)
    assert world.squeeze_nm == pytest.approx(1.0, abs=FORCE_CODE_NM)


def test_an_object_that_vanishes_is_reported_within_50_ms() -> None:
    world, client = world_with(50.0)
    grasped(client, force_n=20)
    world.run(1.5)
    kinds(world)
    world.gripper.remove_object()
    world.run(0.05)
    assert "object_lost" in kinds(world)
    assert not world.state.is_grasped
    width_mm = world.gripper.opening_mm
    world.run(1.0)
    assert world.gripper.opening_mm == pytest.approx(width_mm, abs=1.0)  # they hold where they are


def test_a_hold_in_place_of_a_running_grasp_keeps_what_it_has_grasped() -> None:
    world, client = world_with(40.0)
    number = client.send("motion.grasp", force_n=20, hold_s=60)
    world.run(3.0)
    client.result("motion.hold", if_busy="replace")
    assert client.answers[number]["error"]["data"]["reason"] == "replaced"
    world.run(1.0)
    assert (world.state.is_grasped, world.state.force_set_n) == (True, 20.0)


def test_an_object_that_vanishes_ends_a_running_grasp() -> None:
    world, client = world_with(50.0)
    number = client.send("motion.grasp", force_n=20, hold_s=60)
    world.run(2.0)
    world.gripper.remove_object()
    world.run(0.05)
    assert client.has_answer(number)
    result = client.answers[number]["result"]
    assert (result["ok"], result["outcome"]) == (False, "object_lost")
    assert result["width_mm"] == pytest.approx(50.0, abs=1.0)
    assert kinds(world).count("object_lost") == 1


def test_an_object_that_slips_out_slowly_is_lost_at_the_empty_end() -> None:
    world, client = world_with(12.0, yield_mm_s=10.0)
    result = client.result("motion.grasp", force_n=20, hold_s=10)
    assert result["outcome"] == "object_lost"
    assert world.gripper.opening_mm < 2.0


def test_the_wrong_width_is_told_without_letting_go() -> None:
    world, client = world_with(50.0)
    result = grasped(client, force_n=10, width_mm=40, tolerance_mm=3)
    assert (result["ok"], result["outcome"]) == (False, "wrong_width")
    world.run(1.0)
    assert world.squeeze_nm == pytest.approx(1.0, abs=FORCE_CODE_NM)
    assert world.state.is_grasped
    client.result("motion.open")
    world.gripper.put_object(width_mm=50.0)
    assert grasped(client, force_n=10, width_mm=51, tolerance_mm=3)["ok"]


def test_a_width_that_no_object_between_the_jaws_can_have_is_refused() -> None:
    """Nothing closes for it; one that is within its tolerance may be."""
    world, client = world_with(50.0)
    geometry = world.controller.geometry
    assert geometry is not None
    travel_mm = geometry.travel_mm
    error = client.call("motion.grasp", force_n=10, width_mm=500, tolerance_mm=1)["error"]
    assert error["message"] == (
        f"width_mm is 500 mm, the calibrated travel is {at_most(travel_mm, 3)} mm, and tolerance_mm"
        " 1 mm: no object between the jaws can be so wide"
    )
    data = error["data"]
    assert (data["reason"], data["field"], data["requested"], data["limit"]) == (
        ("out_of_limits", "width_mm", 500, pytest.approx(travel_mm + 1.0))
    )
    assert world.state.mode == "holding"
    assert (
        client.refusal("motion.grasp", width_mm=travel_mm + 3.0, tolerance_mm=2) == "out_of_limits"
    )
    held = grasped(client, force_n=10, width_mm=travel_mm + 5.0, tolerance_mm=travel_mm)
    assert held["ok"]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"width_mm": 20},
            "width_mm is given without tolerance_mm: say how far the width may differ, 2 mm",
        ),
        (
            {"tolerance_mm": 2},
            "tolerance_mm is given without width_mm: say which width is expected, 20 mm",
        ),
    ],
)
def test_the_half_of_an_expected_width_is_refused_by_what_is_missing(
    given: dict[str, float], told: str
) -> None:
    _, client = world_with(50.0)
    error = client.call("motion.grasp", force_n=10, **given)["error"]
    assert error["message"] == f"motion.grasp: {told} for example"
    assert error["data"]["parameter"] not in given


@pytest.mark.parametrize("force_n", [2.0, 5.0, 20.0, 30.0])
def test_the_approach_presses_no_harder_than_its_budget(force_n: float) -> None:
    world, client = world_with(50.0, stiffness_nm_rad=250.0)
    number = client.send("motion.grasp", until="verdict", force_n=force_n)
    peak_nm = max(client.track(number, lambda: world.torque_nm))
    assert peak_nm < 1.3 * max(force_n / 10.0, 0.94)


def test_a_yielding_object_keeps_its_force() -> None:
    """Around a position reading 0.2 s old, kp = 150 would lose most of it."""
    torques = {}
    for hold_by in ("torque", "gains"):
        world, client = world_with(80.0, yield_mm_s=3.0, yield_torque_nm=0.3)
        grasped(client, force_n=20, hold_by=hold_by)
        world.run(1.5)
        torques[hold_by] = fmean(world.track(1.0, partial(getattr, world, "squeeze_nm")))
        assert world.state.is_grasped
    assert torques["torque"] == pytest.approx(2.0, rel=0.05)
    assert torques["gains"] < 1.7


def test_the_gains_of_a_hold_by_gains_are_the_callers() -> None:
    world, client = world_with(50.0)
    grasped(client, hold_by="gains", config={"hold_kp": 80.0, "hold_kd": 1.0})
    world.run(0.1)
    command = world.commands_since(world.now_s)[-1][1]
    assert command.kp_nm_rad == pytest.approx(80.0, abs=0.1)
    assert command.kd_nm_s_rad == pytest.approx(1.0, abs=0.01)


def test_a_stop_keeps_the_hold_but_no_more_force_than_there_is() -> None:
    world, client = world_with(50.0)
    grasped(client, force_n=30, config={"force_rate_n_s": 5})
    world.run(0.5)
    client.result("stop")
    stopped_nm = world.squeeze_nm
    assert 0.9 < stopped_nm < 1.5
    world.run(3.0)
    assert world.squeeze_nm == pytest.approx(stopped_nm, abs=FORCE_CODE_NM)
    assert world.state.is_grasped
    assert client.refusal("motion.set_force", force_n=30) == "stopped"
    world.client().result("stop", level="relax")
    world.run(0.1)
    assert world.torque_nm < 0.05
    assert not world.state.is_grasped


@pytest.mark.parametrize("on_lost", ["hold", "relax", "disable"])
def test_a_client_that_dies_in_a_grasp_leaves_what_it_asked_for(on_lost: str) -> None:
    world, _ = world_with(50.0)
    client = world.client()
    client.result("lease.acquire", on_lost=on_lost)
    client.result("motor.enable")
    client.send("motion.grasp", force_n=10)
    world.run(2.0)
    client.leave()
    world.run(0.5)
    expected_nm = 1.0 if on_lost == "hold" else 0.0
    assert world.squeeze_nm == pytest.approx(expected_nm, abs=FORCE_CODE_NM)
    assert world.state.enabled is (on_lost != "disable")
    assert world.state.is_grasped is (on_lost == "hold")


@pytest.mark.parametrize(
    ("params", "reason"),
    [
        ({"force_n": 41}, "invalid_params"),
        ({"force_n": 40.1}, "invalid_params"),
        ({"force_n": 0.1}, "invalid_params"),
        ({"width_mm": 40}, "invalid_params"),
        ({"tolerance_mm": 4}, "invalid_params"),
        ({"until": "verdict", "hold_s": 1}, "invalid_params"),
        ({"until": "never"}, "invalid_params"),
        ({"speed_mm_s": 1.0}, "out_of_limits"),
        ({"config": {"margin": 0.96}}, "invalid_params"),
        ({"config": {"grasp_speed_mm_s": 1.0}}, "out_of_limits"),
        ({"config": [1]}, "invalid_params"),
    ],
)
def test_what_cannot_be_grasped_so_is_refused_and_nothing_moves(
    params: dict[str, Any], reason: str
) -> None:
    world, client = world_with(50.0)
    before_mm = world.gripper.opening_mm
    assert client.refusal("motion.grasp", **params) == reason
    world.run(0.3)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.1)


@pytest.mark.parametrize(
    ("params", "field"),
    [
        ({"speed_mm_s": 1.0}, "speed_mm_s"),
        ({"config": {"grasp_speed_mm_s": 1.0}}, "grasp_speed_mm_s"),
    ],
)
def test_a_speed_that_is_too_low_is_refused_by_the_name_that_was_sent(
    params: dict[str, Any], field: str
) -> None:
    _, client = world_with(50.0)
    error = client.call("motion.grasp", **params)["error"]
    assert error["data"]["field"] == field
    assert error["message"].startswith(f"{field} is 1, at least ")


def test_progress_tells_the_approach_and_then_the_hold() -> None:
    _, client = world_with(50.0)
    client.result("motion.grasp", force_n=10, hold_s=1.0, progress=True)
    reports = [
        message["params"] for message in client.notifications if message["method"] == "job.progress"
    ]
    phases = [report["phase"] for report in reports]
    assert phases.index("hold") > 0
    assert set(phases[: phases.index("hold")]) == {"approach"}
    assert set(phases[phases.index("hold") :]) == {"hold"}
    assert all(report["total_steps"] == 0 for report in reports if report["phase"] == "hold")
    assert all(report["total_steps"] > 0 for report in reports if report["phase"] == "approach")


def test_a_grasp_is_refused_while_heat_leaves_too_little_torque_to_feel_anything() -> None:
    """It would take its own standing still, short of the end, for an object."""
    world, client = ready()
    world.controller.output.heat.allowance_nm = 0.3
    refused = client.call("motion.grasp", force_n=20)["error"]
    assert refused["data"]["reason"] == "motor_hot"
    assert "0.30 N·m" in refused["message"]
    assert refused["data"]["retryable"]
    world.controller.output.heat.allowance_nm = 2.0
    world.gripper.put_object(width_mm=40.0)
    assert client.result("motion.grasp", force_n=10, until="verdict")["outcome"] == "object_held"
