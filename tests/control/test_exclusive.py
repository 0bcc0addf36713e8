"""Recording, replay and teleoperation exclude each other."""

import pytest

from tests.control.replays import SLOW
from tests.control.teleop_scene import FAKE
from tests.trajectories import uploaded
from tests.world import Client, ready


def begun(client: Client, what: str) -> None:
    """Begin one of them, for long."""
    if what == "teleop":
        client.result("teleop.start", **FAKE)
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
    world, client = ready()
    begun(client, first)
    world.run(0.1)
    for other in (client, world.client()):
        for method, params in (
            ("trajectory.record_start", {}),
            ("trajectory.record_start", {"zero_gravity": False}),
            ("trajectory.play", {"name": "pick"}),
            ("teleop.start", FAKE),
        ):
            error = other.call(method, **params)["error"]["data"]
            assert error["reason"] == reason
            if first == "replaying" and method.startswith("trajectory"):
                assert error["owner"]["program"] == client.session.name
        if first in ("teaching", "replaying"):
            assert other.refusal("motion.open") == "busy"
            assert other.refusal("calibration.load", template="reverse") == "busy"
