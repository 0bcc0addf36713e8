"""Where no motion may begin, every method that moves the jaws is refused for the same reason."""

from typing import Any

import pytest

from litegripd.motor import codec
from tests.control.replays import SLOW
from tests.control.states import in_state
from tests.control.teleop_scene import FAKE, MASTER, SLAVE, TeleopWorld
from tests.trajectories import uploaded

REASONS = {
    "disabled": "not_enabled",
    "fault": "motor_fault",
    "opening": "busy",
    "uncalibrated": "not_calibrated",
    "stopped": "stopped",
    "ending": "shutting_down",
}
MOTIONS: list[tuple[str, dict[str, Any]]] = [
    ("motion.open", {}),
    ("motion.close", {}),
    ("motion.grasp", {}),
    ("motion.move", {"opening_mm": 45.0}),
    ("motion.set_force", {"force_n": 5.0}),
    ("stream.set", {"opening_mm": 50.0}),
    ("calibration.zero", {}),
    ("trajectory.record_start", {}),
    *(("teleop.start", params) for params in (MASTER, SLAVE, FAKE)),
]
NEED_NO_CALIBRATION: list[tuple[str, dict[str, Any]]] = [
    ("motion.hold", {}),
    ("motion.zero_gravity", {}),
    ("calibration.manual", {"step": "begin"}),
]


@pytest.mark.parametrize("state", REASONS)
def test_each_motion_is_refused_to_everybody_and_nothing_moves(state: str) -> None:
    world, reason = TeleopWorld(calibrated=state != "uncalibrated"), REASONS[state]
    client = in_state(state, world)[1] if state in ("disabled", "fault") else world.enabled()
    paths = [(one, uploaded(one, SLOW)) for one in (client, world.client())]
    if state == "opening":
        client.send("motion.open")
        world.run(0.2)
    elif state == "stopped":
        client.result("stop")
    elif state == "ending":
        world.controller.shut_down()
    running, sent = world.controller.jobs.running, len(world.sent)
    refused = MOTIONS if state == "uncalibrated" else MOTIONS + NEED_NO_CALIBRATION
    for one, path in paths:
        for method, params in [*refused, ("trajectory.play", {"name": path})]:
            is_teleop = method == "teleop.start" and state in ("disabled", "uncalibrated")
            expected = "teleop_not_ready" if is_teleop else reason
            assert one.refusal(method, **params) == expected, method
        if state not in ("opening", "stopped"):  # a recording may watch what others do
            assert one.refusal("trajectory.record_start", zero_gravity=False) == reason
    assert world.controller.jobs.running is running
    assert world.wires.made == []
    assert not client.result("teleop.status")["active"]
    world.run(0.1)
    assert codec.ENABLE not in [later.frame.data for later in world.sent[sent:]]


def test_jaws_of_unknown_travel_are_held_where_they_are() -> None:
    world = TeleopWorld(calibrated=False)
    held = world.enabled().result("motion.hold")
    assert held["position_rad"] == pytest.approx(world.gripper.position_rad, abs=1e-3)
