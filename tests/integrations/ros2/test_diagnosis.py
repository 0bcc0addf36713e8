"""What /diagnostics says, with the real daemon's health and state."""

from typing import Any

import pytest

from litegrip_client import GripperState
from litegrip_ros2.diagnosis import Diagnosis, Level, of_gripper, of_no_daemon
from tests.world import Client, ready


def diagnosed(client: Client, **changed: Any) -> Diagnosis:
    state = GripperState.from_wire({**client.result("state.get"), **changed})
    return of_gripper(client.result("health"), state, "the last one")


def test_a_gripper_that_is_well() -> None:
    _, client = ready()
    what = diagnosed(client)
    assert (what.level, what.message) == (Level.OK, "ok")
    assert what.values["last refusal"] == "the last one"
    assert what.values["enabled"] == "yes"
    assert what.values["bus"] == "up"
    assert float(what.values["opening (mm)"]) == pytest.approx(
        client.result("state.get")["opening_mm"], abs=0.1
    )
    assert all(isinstance(value, str) for value in what.values.values())


@pytest.mark.parametrize(
    ("verdict", "level"),
    [
        ("ok", Level.OK),
        ("degraded", Level.WARN),
        ("down", Level.ERROR),
        ("of a newer daemon", Level.ERROR),
    ],
)
def test_the_daemons_verdict_is_the_level(verdict: str, level: Level) -> None:
    what = of_gripper({"verdict": verdict, "reasons": ["one", "two"]}, None)
    assert (what.level, what.message) == (level, "one; two")


def test_a_stop_is_a_warning_with_its_reason() -> None:
    _, client = ready()
    client.result("stop", level="relax", why="the door is open")
    what = diagnosed(client)
    assert (what.level, what.message) == (Level.WARN, "stopped (relax): the door is open")
    assert what.values["stop"] == "relax"


def test_a_gripper_that_is_not_calibrated_or_whose_figures_are_old_is_a_warning() -> None:
    _, client = ready()
    assert diagnosed(client, calibrated=False).message == "not calibrated"
    old = diagnosed(client, stale=True)
    assert (old.level, "old" in old.message) == (Level.WARN, True)


def test_an_object_and_who_moves_the_jaws_are_told() -> None:
    world, client = ready()
    client.result("motion.open")
    world.gripper.put_object(width_mm=50.0)
    client.send("motion.grasp", force_n=10)
    world.run(3.0)
    values = diagnosed(client).values
    assert values["object held"] == "yes"
    assert values["job"] == "grasp"
    assert values["owner of the job"] == client.result("job.list")["jobs"][-1]["owner"]["program"]


def test_no_daemon_is_an_error_that_says_why() -> None:
    what = of_no_daemon("no daemon can be reached\nstart one", "busy")
    assert (what.level, what.message) == (Level.ERROR, "no daemon: no daemon can be reached")
    assert what.values == {"last refusal": "busy"}
    assert of_no_daemon("").message == "no daemon: not connected yet"
