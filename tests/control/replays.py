"""Replays on the simulated gripper, for the scenes about them."""

from typing import Any

from litegripd.model.calibration import NOMINAL
from litegripd.trajectories.replay import Replay
from tests.trajectories import Point, sampled, swing, uploaded
from tests.world import Client, World

TRAVEL_MM = NOMINAL[0].travel_mm
SLOW = sampled(swing(period_s=8.0), 4.0)
TOLERANCE = 0.01
"""Of the travel: what the jaws may be off their path."""


def playing(world: World) -> Replay:
    action = world.controller.action
    assert isinstance(action, Replay)
    return action


def started(world: World, client: Client, points: list[Point], **params: Any) -> int:
    """Begin a replay and let it come onto its path; return the request's number."""
    number = client.send("trajectory.play", name=uploaded(client, points), **params)
    world.run_until(lambda: playing(world).phase == "play")
    return number


def openness(world: World) -> float:
    """The true openness, by the calibration in use."""
    geometry = world.geometry
    return geometry.opening_mm(world.gripper.position_rad) / geometry.travel_mm


def followed(world: World, client: Client, number: int) -> list[float]:
    """Run a replay to its end; return how far the jaws were off, as shares of the travel."""
    errors = []
    while not client.has_answer(number):
        action = world.controller.action
        on_path = isinstance(action, Replay) and action.phase == "play"
        wanted = action.openness if isinstance(action, Replay) else None
        world.tick()  # what was commanded takes until now
        if on_path and wanted is not None:
            errors.append(abs(openness(world) - wanted))
    return errors


def result_of(client: Client, number: int) -> dict[str, Any]:
    answer = client.wait(number)
    assert "result" in answer, answer
    result: dict[str, Any] = answer["result"]
    return result


def reason_of(client: Client, number: int) -> str:
    reason: str = client.wait(number)["error"]["data"]["reason"]
    return reason
