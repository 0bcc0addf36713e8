"""Recordings on the simulated gripper, for the scenes about them."""

from typing import Any

from litegripd.trajectories.values import read
from tests.trajectories import fetched, points_of
from tests.world import Client, World


def recording(world: World | None = None, **params: Any) -> tuple[World, Client]:
    world = world or World()
    client = world.enabled()
    status = client.result("trajectory.record_start", **params)
    assert (status["active"], status["kind"], status["samples"]) == (True, "record", 0)
    return world, client


def taken(client: Client, **params: Any) -> list[tuple[float, ...]]:
    """End the recording and fetch its samples."""
    name = client.result("trajectory.record_stop", **params)["name"]
    content = fetched(client, name=name)
    read(memoryview(content))
    return points_of(content)
