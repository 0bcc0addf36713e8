"""Recording, replay and teleoperation exclude each other."""

import pytest

from tests.control.replays import SLOW
from tests.trajectories import uploaded
from tests.world import Client, World

TELEOP = {"mode": "slave", "fake_leader": True}


def begun(client: Client, what: str) -> None:
    """Begin one of them, for long."""
    if what == "teleop":
        client.result("teleop.start", **TELEOP)
    elif what == "replaying":
        client.send("trajectory.play", name=uploaded(client, SLOW))
    elif what == "watching":
        client.result("trajectory.record_start", zero_gravity=False)
    else:
        client.result("trajectory.record_start")


@pytest.mark.parametrize(
    ("first", "reason"),
    [
        ("teleop", "teleop_busy"),
        ("watching", "trajectory_busy"),
        ("teaching", "trajectory_busy"),
        ("replaying", "trajectory_busy"),
    ],
)
def test_whatever_runs_first_excludes_the_others(first: str, reason: str) -> None:
    world = World()
    client = world.enabled()
    begun(client, first)
    world.run(0.1)
    assert client.refusal("trajectory.record_start", zero_gravity=False) == reason
    assert client.refusal("trajectory.play", name="pick") == reason
    assert client.refusal("teleop.start", **TELEOP) == reason
