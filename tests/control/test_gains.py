"""Gains that cannot be safe: refused where a caller gives them, without effect in a file."""

from functools import cache
from typing import Any

import pytest

from litegripd.control.limiter import DEFAULT_GAINS, Gains
from litegripd.model.calibration import Calibration
from litegripd.model.motion_config import LEAST_DAMPING_S, damping_conflict
from tests.control.replays import SLOW
from tests.control.teleop_scene import FAKE
from tests.plants.holds import unguard
from tests.plants.parameters import PlantParameters
from tests.plants.world import PlantWorld
from tests.trajectories import uploaded
from tests.world import World, ready


def shaken_mm_s(gains: Gains, *, guarded: bool = False) -> float:
    """Return how fast the jaws still are a second after a blow, on a motor that is no simulator."""
    world = PlantWorld(PlantParameters(), "normal", 200, opening_mm=60.0)
    geometry = world.geometry
    kp, kd = gains.kp_nm_rad, gains.kd_nm_s_rad
    world.controller.use_calibration(Calibration(geometry, kp_nm_rad=kp, kd_nm_s_rad=kd))
    if not guarded:
        unguard(world.controller)
    world.enabled()
    world.mechanics.rotor_rad_s += 3.0
    world.run(1.0)
    return max(abs(look.rotor_mm_s) for look in world.looks_since(world.now_s - 0.2))


@pytest.mark.parametrize("kp_nm_rad", [100.0, 200.0, 300.0, 500.0])
def test_the_bound_is_where_jaws_swing_by_themselves(kp_nm_rad: float) -> None:
    assert shaken_mm_s(Gains(kp_nm_rad, 0.0)) > 1000.0
    least = LEAST_DAMPING_S * kp_nm_rad
    assert damping_conflict(kp_nm_rad, least) is None
    assert shaken_mm_s(Gains(kp_nm_rad, least)) < 1.0
    conflict = damping_conflict(kp_nm_rad, 0.999 * least)
    assert conflict is not None
    assert conflict.field == "kd"
    assert conflict.limit == pytest.approx(least)


@pytest.mark.parametrize("kp_nm_rad", [5.0, 100.0, 500.0])
def test_jaws_held_by_a_file_without_damping_do_not_swing(kp_nm_rad: float) -> None:
    """A blow as that by which they swing without the bound of holds."""
    assert shaken_mm_s(Gains(kp_nm_rad, 0.0), guarded=True) < 1.0


@pytest.mark.parametrize("kp_nm_rad", [5.0, 100.0, 500.0])
def test_no_command_is_without_damping_because_a_file_is(kp_nm_rad: float) -> None:
    """Of all that uses a file's gains: the hold, a stream, a follower."""
    world, client = ready()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content={**content, "kp": kp_nm_rad, "kd": 0})
    since_s = world.now_s
    client.result("motion.move", opening_mm=50.0)
    world.run(0.5)
    client.result("stream.set", opening_mm=40.0)
    world.run(0.5)
    client.result("teleop.start", **FAKE)
    world.run(1.0)
    stiff = [command for _, command in world.commands_since(since_s) if command.kp_nm_rad > 0.0]
    assert len(stiff) > 200
    assert all(damping_conflict(each.kp_nm_rad, each.kd_nm_s_rad) is None for each in stiff)


def test_a_file_with_one_gain_does_not_get_the_other_of_a_stiffer_one() -> None:
    world, client = ready()
    content = client.result("calibration.get")["content"]
    for kp, kd, expected in (
        (500, 1.5, Gains(500.0, 1.5)),
        (None, 0.3, Gains(100.0, 0.3)),  # and not with the 500 of before
        (None, None, Gains(100.0, 0.3)),
        (150, None, Gains(150.0, 0.3)),
        (400, None, Gains(400.0, 2.0)),
    ):
        given = {name: gain for name, gain in {"kp": kp, "kd": kd}.items() if gain is not None}
        bare = {name: value for name, value in content.items() if name not in ("kp", "kd")}
        client.result("calibration.load", content={**bare, **given})
        assert world.controller.gains == expected


FILES = [
    (1.0, 0.0),
    (500.0, 0.0),
    (5.0, 2.0),
    (5.0, 5.0),
    (50.0, 0.1),
    (200.0, 2.0),
    (500.0, 1.0),
    (500.0, 5.0),
]


@cache
def came_to(kp_nm_rad: float, kd_nm_s_rad: float) -> list[tuple[str, float, float]]:
    """Return outcome, place (mm) and time (s) of some motions with a file of these gains."""
    world = World()
    geometry = world.geometry
    file = Calibration(geometry, kp_nm_rad=kp_nm_rad, kd_nm_s_rad=kd_nm_s_rad)
    world.controller.use_calibration(file)
    client, seen = world.enabled(), []
    for method, params in (
        ("motion.open", {}),
        ("motion.close", {"speed_mm_s": 100.0}),
        ("motion.move", {"opening_mm": 60.0}),
        ("motion.move", {"opening_mm": 58.0, "speed_mm_s": 5.0}),
        ("motion.move", {"openness": 0.1, "speed_mm_s": 150.0}),
        ("motion.open", {"speed_mm_s": 20.0}),
    ):
        began_s = world.now_s
        outcome = client.result(method, **params)["outcome"]
        seen.append((outcome, world.gripper.opening_mm, world.now_s - began_s))
    return seen


@pytest.mark.parametrize(("kp_nm_rad", "kd_nm_s_rad"), FILES)
def test_no_gains_of_a_file_change_what_a_motion_comes_to(
    kp_nm_rad: float, kd_nm_s_rad: float
) -> None:
    usual = came_to(DEFAULT_GAINS.kp_nm_rad, DEFAULT_GAINS.kd_nm_s_rad)
    assert [outcome for outcome, _, _ in usual] == [
        "pressed_home",
        "pressed_home",
        "reached",
        "reached",
        "reached",
        "pressed_home",
    ]
    for ours, theirs in zip(came_to(kp_nm_rad, kd_nm_s_rad), usual, strict=True):
        assert ours[0] == theirs[0]
        assert ours[1] == pytest.approx(theirs[1], abs=0.6)
        assert ours[2] == pytest.approx(theirs[2], abs=0.05)


@pytest.mark.parametrize(
    ("method", "gains", "least"),
    [
        ("teleop.start", {"kp": 500, "kd": 0.1}, 1.0),
        ("teleop.start", {"kp": 500}, 1.0),  # and the file's kd
        ("teleop.start", {"kd": 0.1}, 0.2),
        ("trajectory.play", {"kp": 500, "kd": 0.1}, 1.0),
        ("trajectory.play", {"kd": 0.1}, 0.2),
        ("motion.move", {"kp": 500, "kd": 0.1}, 1.0),
        ("motion.move", {"kd": 0.1}, 0.2),
        ("stream.set", {"kp": 500, "kd": 0.5}, 1.0),
    ],
)
def test_what_a_motion_gives_is_judged_with_what_it_leaves_out(
    method: str, gains: dict[str, Any], least: float
) -> None:
    world, client = ready()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content={**content, "kp": 100, "kd": 0.5})
    if method == "trajectory.play":
        params: dict[str, Any] = {"name": uploaded(client, SLOW)}
    else:
        params = FAKE if method == "teleop.start" else {"opening_mm": 30.0}
    error = client.call(method, **params, **gains)["error"]
    assert error["data"]["reason"] == "out_of_limits"
    assert (error["data"]["field"], error["data"]["limit"]) == ("kd", pytest.approx(least))
    assert world.controller.jobs.running is None


@pytest.mark.parametrize("method", ["trajectory.play", "motion.move"])
def test_a_motion_does_not_take_what_it_leaves_out_from_the_file(method: str) -> None:
    """The usual damping, 2 N·m·s/rad, goes with every stiffness."""
    world, client = ready()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content={**content, "kp": 100, "kd": 0.5})
    plays = method == "trajectory.play"
    params: dict[str, Any] = {"name": uploaded(client, SLOW)} if plays else {"opening_mm": 30.0}
    since_s = world.now_s
    assert client.result(method, **params, kp=500)["ok"]
    dampings = {round(command.kd_nm_s_rad, 1) for _, command in world.commands_since(since_s)}
    assert 2.0 in dampings


def test_a_hold_by_gains_damps_enough_or_is_refused() -> None:
    world, client = ready()
    grasp: dict[str, Any] = {"hold_by": "gains", "until": "verdict"}
    error = client.call("motion.grasp", **grasp, config={"hold_kp": 300, "hold_kd": 0.1})["error"]
    assert error["data"]["field"] == "hold_kd"
    assert "hold_kd is 0.1, with hold_kp 300 it must be at least 0.6" in error["message"]
    world.gripper.put_object(width_mm=50.0)
    assert client.result("motion.grasp", **grasp, config={"hold_kp": 300, "hold_kd": 0.6})["ok"]
