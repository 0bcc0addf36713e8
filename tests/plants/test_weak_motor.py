"""A motor that makes less torque than is commanded: that is reported, and no grasp succeeds."""

from dataclasses import replace
from typing import Any

import pytest

from tests.plants.clamps import KINDS, clamp_trial, plain_trial, rig_of
from tests.plants.parameters import PlantParameters
from tests.world import Client

FORCE_N = 20.0
RIPPLED = PlantParameters(torque_noise_nm=0.05, cogging_nm=0.05, speed_noise_rad_s=0.3)

RATED = [(200, 0.05), (200, 0.15), (200, 0.3), (200, 0.5)]
RATED += [(100, 0.05), (1000, 0.05)]
"""Rates, and what a motor makes of its torque: at each rate the least; the most is each test's."""

any_rig = pytest.mark.parametrize("name", KINDS)


class Scene:
    """A gripper, its client, and the events about the motor's torque."""

    def __init__(self, name: str, rate_hz: int = 200, plant: PlantParameters = RIPPLED) -> None:
        self.world = rig_of(name, replace(plain_trial(plant, FORCE_N), rate_hz=rate_hz))
        self.client: Client = self.world.enabled()
        self.client.result("events.subscribe", kinds=["weak"])

    def grasp(self, until: str = "verdict") -> dict[str, Any]:
        return self.client.result("motion.grasp", force_n=FORCE_N, until=until)

    def weak(self) -> list[bool]:
        """Return for each event whether the motor is weak by it."""
        return [event["data"]["weak"] for event in self.client.events()]


@any_rig
@pytest.mark.parametrize(
    ("rate_hz", "made_share"), [*RATED, *((rate_hz, 0.7) for rate_hz in (100, 200, 1000))]
)
def test_in_a_hold_it_is_reported_once_and_lowers_the_interval(
    name: str, rate_hz: int, made_share: float
) -> None:
    scene = Scene(name, rate_hz)
    assert scene.grasp()["outcome"] == "object_held"
    scene.world.run(1.0)
    assert scene.weak() == []
    scene.world.weaken(made_share)
    scene.world.run(0.25)
    assert scene.weak() == [True]
    scene.world.run(1.0)
    low_n, high_n = scene.world.clamp_range_n
    assert scene.weak() == [True]
    assert low_n <= made_share * FORCE_N
    assert low_n <= scene.world.true_n <= high_n
    assert scene.world.state.is_grasped


@any_rig
@pytest.mark.parametrize("made_share", [0.75, 0.8, 0.85, 0.9, 0.95])
def test_the_truth_is_inside_where_it_is_a_little_weak(name: str, made_share: float) -> None:
    scene = Scene(name)
    scene.world.weaken(made_share)
    scene.grasp()
    scene.world.run(1.5)
    low_n, high_n = scene.world.clamp_range_n
    assert low_n <= scene.world.true_n <= high_n


@any_rig
def test_its_recovery_is_reported_too(name: str) -> None:
    scene = Scene(name)
    scene.grasp()
    scene.world.run(1.0)
    before_n = scene.world.state.clamp_n
    scene.world.weaken(0.3)
    scene.world.run(0.5)
    scene.world.weaken(1.0)
    scene.world.run(0.5)
    assert scene.weak() == [True, False]
    assert scene.world.state.clamp_n == pytest.approx(before_n, abs=0.2)


@any_rig
@pytest.mark.parametrize("until", ["verdict", "held"])
@pytest.mark.parametrize(
    ("rate_hz", "made_share"), [*RATED, *((rate_hz, 0.6) for rate_hz in (100, 200, 1000))]
)
def test_a_grasp_by_a_weak_motor_is_no_success(
    name: str, rate_hz: int, until: str, made_share: float
) -> None:
    scene = Scene(name, rate_hz)
    scene.world.weaken(made_share)
    result = scene.grasp(until)
    assert (result["ok"], result["outcome"]) == (False, "motor_weak")
    assert scene.world.state.force_set_n == FORCE_N  # what may be held is not let go
    scene.world.run(0.3)
    assert scene.weak() == [True]


@any_rig
@pytest.mark.parametrize("made_share", [0.05, 0.15, 0.3, 0.6])
def test_it_never_claims_to_hold_what_it_is_too_weak_to_feel(name: str, made_share: float) -> None:
    scene = Scene(name)
    scene.world.weaken(made_share)
    assert scene.grasp()["outcome"] == "motor_weak"
    assert scene.world.state.is_grasped is None
    claimed = scene.world.track(1.5, lambda: scene.world.state.is_grasped)
    assert True not in claimed


@any_rig
@pytest.mark.parametrize("made_share", [0.3, 0.6])
def test_what_it_holds_is_known_once_it_is_strong_again(name: str, made_share: float) -> None:
    scene = Scene(name)
    scene.world.weaken(made_share)
    scene.grasp()
    scene.world.run(1.0)
    scene.world.weaken(1.0)
    scene.world.run(1.5)
    assert scene.world.state.is_grasped is True
    assert scene.world.true_n > 0.5 * FORCE_N


@any_rig
def test_where_it_holds_nothing_that_is_told_once_it_is_strong_again(name: str) -> None:
    """Friction stands against all that it makes, wherever the jaws are."""
    scene = Scene(name)
    scene.world.remove()
    scene.client.result("events.subscribe", kinds=["object_lost"])
    scene.world.weaken(0.02)
    assert scene.grasp()["outcome"] == "motor_weak"
    assert scene.world.state.is_grasped is None
    scene.world.run(0.5)
    scene.world.weaken(1.0)
    claimed = scene.world.track(3.0, lambda: scene.world.state.is_grasped)
    assert True not in claimed
    assert claimed[-1] is False
    (told,) = (one["message"] for one in scene.client.events() if one["kind"] == "object_lost")
    assert told.startswith("there is no object, or it is lost: the jaws closed on")


@any_rig
def test_a_hold_for_some_time_that_ends_weak_is_none_either(name: str) -> None:
    scene = Scene(name)
    number = scene.client.send("motion.grasp", force_n=FORCE_N, hold_s=2.0)
    scene.world.run(1.0)
    scene.world.weaken(0.5)
    assert scene.client.wait(number)["result"]["outcome"] == "motor_weak"


@any_rig
def test_a_grasp_of_what_is_held_already_is_none_either(name: str) -> None:
    scene = Scene(name)
    assert scene.grasp()["ok"]
    scene.world.run(1.0)
    scene.world.weaken(0.3)
    scene.world.run(0.3)
    assert scene.grasp()["outcome"] == "motor_weak"
    assert scene.world.state.is_grasped


@any_rig
def test_a_move_against_something_shows_it_as_well(name: str) -> None:
    scene = Scene(name)
    scene.world.weaken(0.15)
    assert not scene.client.result("motion.move", openness=0.2)["ok"]
    scene.world.run(0.1)
    assert scene.weak() == [True]


@any_rig
@pytest.mark.parametrize("seed", range(1, 13))
def test_a_whole_motor_is_never_called_weak(name: str, seed: int) -> None:
    """In grips that are bumped, lowered, and search; in moves; held back by a hand."""
    trial = clamp_trial(seed, 0.2)
    world = rig_of(name, trial)
    client = world.enabled()
    client.result("events.subscribe", kinds=["weak"])
    client.call("motion.grasp", force_n=trial.force_n, until="verdict")
    world.run(1.0)
    for closing_nm in (-trial.push_nm, 0.0, trial.push_nm, 0.0):
        world.hand(closing_nm)
        world.run(0.3)
    client.call("motion.set_force", force_n=trial.lower_n)
    world.run(1.0)
    world.give_way(trial.step_mm)
    world.run(0.5)
    client.call("motion.open")
    client.call("motion.move", openness=0.1)
    world.hand(-2.5)
    world.run(1.0)
    assert client.events() == []
