"""What the object feels is what was asked for, as far as friction allows, and is reported."""

from typing import Any

import pytest

from tests.control.held import Held, every_mount, every_setting
from tests.world import World


@every_setting
@pytest.mark.parametrize("force_n", [2.0, 3.0, 5.0, 10.0, 20.0, 30.0])
def test_the_true_clamp_lies_in_the_reported_interval(
    force_n: float, rate_hz: int, mount: str
) -> None:
    held = Held(force_n, mount, rate_hz)
    for _ in range(20):
        held.run(0.05)
        low_n, high_n = held.clamp_range_n
        assert low_n <= held.clamp_n <= high_n
        assert low_n <= force_n <= high_n
        assert high_n - low_n < 2.0 * (3.6 + 0.1 * max(force_n, 10.5))  # the approach's


@every_setting
@pytest.mark.parametrize("until", ["verdict", "held"])
@pytest.mark.parametrize("force_n", [3.0, 8.0, 20.0])
def test_the_interval_is_true_from_the_first_moment_of_a_hold(
    force_n: float, until: str, rate_hz: int, mount: str
) -> None:
    """A program reads it from the grasp's own answer."""
    world = World(mount, period_s=1.0 / rate_hz, initial_opening_mm=70.0)
    world.gripper.put_object(width_mm=50.0)
    client = world.enabled()
    number = client.send("motion.grasp", force_n=force_n, until=until)
    world.run_until(lambda: world.controller.grip is not None)
    for _ in range(40):
        state, true_n = world.state, 10.0 * world.gripper.clamp_nm
        assert state.clamp_n is not None
        assert state.clamp_n[0] <= true_n <= state.clamp_n[1]
        world.run(1.0 / rate_hz)
    assert client.has_answer(number) is (until == "verdict")


@every_setting
@pytest.mark.parametrize("force_n", [2.0, 3.0, 5.0])
def test_a_gentle_grip_is_gentle(force_n: float, rate_hz: int, mount: str) -> None:
    """Friction would keep the approach's 10 N in it, less what it takes itself."""
    within_n = 0.5 if rate_hz == 200 else 0.9
    assert Held(force_n, mount, rate_hz).clamp_n == pytest.approx(force_n, abs=within_n)


def test_a_force_that_is_lowered_is_felt_so_too() -> None:
    held = Held(20.0)
    held.owner.result("motion.set_force", force_n=5)
    held.run(1.5)
    assert held.clamp_n == pytest.approx(5.0, abs=0.6)
    assert held.state.is_grasped


@every_mount
@pytest.mark.parametrize(
    ("first", "again", "least_n"),
    [
        ({}, {}, 25.0),
        ({}, {"hold_s": 0.3}, 25.0),
        ({}, {"width_mm": 50, "tolerance_mm": 3}, 25.0),
        ({}, {"width_mm": 20, "tolerance_mm": 3}, 25.0),
        ({}, {"hold_by": "gains"}, 25.0),
        ({"hold_by": "gains"}, {"hold_by": "gains"}, 25.0),
        ({"hold_by": "gains"}, {}, 15.0),
    ],
)
def test_a_regrasp_of_what_is_held_never_halves_its_clamp(
    first: dict[str, Any], again: dict[str, Any], least_n: float, mount: str
) -> None:
    held = Held(30.0, mount, **first)
    params = {"until": "verdict", **again} if "hold_s" not in again else again
    number = held.owner.send("motion.grasp", force_n=30, **params)
    assert held.least_clamp_n(1.5) > least_n
    assert held.owner.has_answer(number)
    result = held.owner.answers[number]["result"]
    expected = "wrong_width" if again.get("width_mm") == 20 else "object_held"
    assert result["outcome"] == expected
    assert result["width_mm"] == pytest.approx(50.0, abs=1.0)
    assert held.state.is_grasped
    assert held.events("object_lost") == []


def test_a_regrasp_with_another_force_goes_there_without_letting_go() -> None:
    held = Held(30.0)
    held.owner.result("motion.grasp", force_n=15, until="verdict")
    assert held.least_clamp_n(1.5) > 11.0
    assert held.clamp_n == pytest.approx(15.0, abs=2.0)
    held.owner.result("motion.grasp", force_n=25, until="verdict")
    assert held.least_clamp_n(1.5) > 12.0
    assert held.clamp_n == pytest.approx(25.0, abs=2.5)


def test_without_a_hold_nothing_is_said_of_its_clamp() -> None:
    held = Held(10.0)
    held.owner.result("motion.open")
    state = held.state
    assert (state.clamp_n, state.loss_detection, state.loss_detection_from_n) == (None,) * 3


def test_while_the_jaws_search_the_object_may_feel_nothing() -> None:
    held = Held(10.0)
    held.gripper.give_way(1.8)
    assert 0.0 in held.track(0.06, lambda: held.clamp_range_n[0])
    held.run(0.5)
    assert held.clamp_range_n[0] > 5.0
