"""How goals are carried out, and what their ends are in ROS: with the real daemon's answers."""

from typing import Any

import pytest

from litegrip_client import GraspResult, LiteGripError, MoveResult
from litegrip_client.values.errors import from_error_object
from litegrip_fleet.wire.answers import TOO_LATE, UNREACHABLE, error_object
from litegrip_ros2.joints import Target
from litegrip_ros2.orders import (
    Ending,
    Outcome,
    Plan,
    has_not_arrived,
    in_ros,
    of_error,
    of_grasp,
    of_move,
    plan,
    refusal,
)
from tests.world import Client, World, ready

TRAVEL_MM = 80.0


@pytest.mark.parametrize(
    ("target", "opening_mm", "planned"),
    [
        (Target(20.0), 60.0, Plan(20.0, None)),
        (Target(20.0, 30.0), 60.0, Plan(20.0, 30.0)),
        (Target(20.0, 30.0, 5.0), 60.0, Plan(20.0, 30.0, 5.0, 0.25)),
        (Target(0.0, None, 5.0), 60.0, Plan(0.0, None, 5.0, 0.0)),
        (Target(76.0, None, 5.0), 79.0, Plan(76.0, None, 5.0, 0.95)),
        (Target(20.0, None, 5.0), None, Plan(20.0, None, 5.0, 0.25)),
        (Target(20.0, None, 5.0), 19.5, Plan(20.0, None, 5.0, 0.25)),  # it may hold something there
        (Target(60.0, 30.0, 5.0), 20.0, Plan(60.0, 30.0)),  # what opens presses on nothing
        (Target(79.0, None, 5.0), 80.0, Plan(79.0, None)),  # too far open for a grasp
        (Target(95.0, None, 5.0), 60.0, Plan(95.0, None)),  # the daemon refuses it
        (Target(-9.0, None, 5.0), 60.0, Plan(-9.0, None)),
    ],
)
def test_a_force_that_closes_is_a_grasp_and_all_else_a_move(
    target: Target, opening_mm: float | None, planned: Plan
) -> None:
    assert plan(target, opening_mm, TRAVEL_MM) == planned


def moved(world: World, client: Client, opening_mm: float) -> MoveResult:
    assert world.state.enabled
    return MoveResult.from_wire(client.result("motion.move", opening_mm=opening_mm))


def grasped(client: Client, **params: Any) -> GraspResult:
    return GraspResult.from_wire(client.result("motion.grasp", until="verdict", **params))


def essence(outcome: Outcome) -> tuple[Ending, bool, bool, str]:
    """Return ending, reached_goal, stalled and reason."""
    assert outcome.state is not None
    assert bool(outcome.why) == bool(outcome.reason)
    return outcome.ending, outcome.reached_goal, outcome.stalled, outcome.reason


def test_a_move_that_arrives_has_reached_its_goal() -> None:
    world, client = ready()
    outcome = of_move(moved(world, client, 20.0), allow_stalling=False)
    assert essence(outcome) == (Ending.SUCCEEDED, True, False, "")


@pytest.mark.parametrize(
    ("allow_stalling", "ending"), [(False, Ending.ABORTED), (True, Ending.SUCCEEDED)]
)
def test_a_move_that_is_blocked_has_stalled(allow_stalling: bool, ending: Ending) -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.put_object(width_mm=50.0)
    outcome = of_move(moved(world, client, 20.0), allow_stalling=allow_stalling)
    assert essence(outcome) == (ending, False, True, "blocked")


def test_a_grasp_that_holds_something_has_stalled_and_succeeded() -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.put_object(width_mm=50.0)
    outcome = of_grasp(grasped(client, force_n=10))
    assert essence(outcome) == (Ending.SUCCEEDED, False, True, "")


def test_a_grasp_of_nothing_has_reached_the_position() -> None:
    _, client = ready()
    client.result("motion.open")
    outcome = of_grasp(grasped(client, force_n=10))
    assert essence(outcome) == (Ending.SUCCEEDED, True, False, "")


@pytest.mark.parametrize(
    ("name", "stalled", "why"),
    [
        ("object_lost", False, "the object was lost"),
        ("timed_out", False, "in time"),
        ("motor_weak", True, "less torque"),
        ("of_a_newer_daemon", False, "of_a_newer_daemon"),
    ],
)
def test_a_grasp_that_ends_otherwise_is_aborted_and_says_why(
    name: str, stalled: bool, why: str
) -> None:
    _, client = ready()
    data = client.result("motion.grasp", until="verdict", force_n=10)
    outcome = of_grasp(GraspResult.from_wire({**data, "ok": False, "outcome": name}))
    assert essence(outcome) == (Ending.ABORTED, False, stalled, name)
    assert why in outcome.why


def refused(client: Client, method: str, **params: Any) -> LiteGripError:
    """Return what a client of this node raises for a refusal of the real daemon."""
    return from_error_object(client.call(method, **params)["error"], method, in_ros)


def test_a_refusal_names_the_services_that_help() -> None:
    world, client = ready()
    client.result("stop", why="the door is open")
    stopped = of_error(refused(client, "motion.open"))
    assert (stopped.ending, stopped.reason) == (Ending.ABORTED, "stopped")
    assert "the door is open" in stopped.why
    assert "~/clear" in stopped.why
    client.result("stop.clear")
    client.result("motor.disable")
    assert "~/enable" in refusal(refused(client, "motion.open"))
    assert world.state.enabled is False


def test_a_refusal_names_who_has_the_lease() -> None:
    world, client = ready()
    owner = world.client()
    owner.result("hello", client="pick_and_place")
    owner.result("lease.acquire", purpose="sorting")
    text = refusal(refused(client, "motion.open"))
    assert "pick_and_place" in text
    assert "sorting" in text
    assert "litegripctl lease" in text
    assert "\n" not in text


def test_a_refusal_names_parameters_as_the_daemon_does() -> None:
    _, client = ready()
    assert refusal(refused(client, "motion.move", opening_mm=200.0)).startswith("opening_mm is 200")


@pytest.mark.parametrize("code", [UNREACHABLE, TOO_LATE])
def test_what_a_network_kept_may_be_asked_again(code: int) -> None:
    error = from_error_object(error_object(code, "lab.left"), "motor.enable", in_ros)
    assert has_not_arrived(error)


def test_what_the_daemon_refused_is_not_asked_again() -> None:
    _, client = ready()
    client.result("stop")
    assert not has_not_arrived(refused(client, "motor.enable"))
