"""A calibration that a request brings: it counts for that motion and what it leaves, and for nobody
else."""

from typing import Any

import pytest

from litegripd.control.holds import Grip, Hold
from litegripd.model.calibration import GIVEN_KEYS, NOMINAL
from litegripd.sim.plant import limits_of_mount
from tests.world import Client, World

MOUNTS = ("normal", "reverse")
MM_RAD = NOMINAL[0].rad_to_mm
NEAR_MM = 1.06
"""`reach_tol` of 0.02 rad."""
SUPERSEDED_MM_RAD = 120.0 / NOMINAL[0].travel_rad


def given(mount: str = "normal", **keys: object) -> dict[str, Any]:
    closed_rad, open_rad = limits_of_mount(mount)
    limits = {"zero_position_rad": closed_rad, "max_position_rad": open_rad}
    return {**limits, "rad_to_mm": MM_RAD, **keys}


def gripper(
    mount: str = "normal", *, calibrated: bool = False, width_mm: float | None = None
) -> tuple[World, Client]:
    world = World(mount, calibrated, initial_opening_mm=60.0)
    if width_mm is not None:
        world.gripper.put_object(width_mm=width_mm)
    return world, world.enabled()


def stream(world: World, client: Client, duration_s: float, **params: Any) -> None:
    """Keep a stream up by a set-point, a notification, in each tick."""
    for _ in range(round(duration_s / world.period_s)):
        client.notify("stream.set", **params)
        world.tick()


@pytest.mark.parametrize("mount", MOUNTS)
def test_every_motion_goes_by_it_where_the_daemon_has_none(mount: str) -> None:
    world, client = gripper(mount, width_mm=30.0)
    calibration = given(mount)
    for method, needed in (
        ("motion.open", {}),
        ("motion.close", {}),
        ("motion.grasp", {}),
        ("motion.move", {"opening_mm": 50.0}),
        ("motion.set_force", {"force_n": 5.0}),
        ("stream.set", {"opening_mm": 50.0}),
        ("trajectory.record_start", {"zero_gravity": False}),
    ):
        assert client.refusal(method, **needed) == "not_calibrated", method
    assert client.result("motion.move", opening_mm=50.0, calibration=calibration)["ok"]
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=NEAR_MM)
    assert client.result("motion.open", calibration=calibration)["outcome"] == "pressed_home"
    stream(world, client, 1.0, openness=0.5, calibration=calibration)
    world.run(0.3)
    assert world.gripper.opening_mm == pytest.approx(NOMINAL[0].travel_mm / 2.0, abs=NEAR_MM)
    grasped = client.result("motion.grasp", force_n=10.0, until="verdict", calibration=calibration)
    assert (grasped["outcome"], grasped["width_mm"]) == ("object_held", pytest.approx(30.0, abs=1))
    state = client.result("state.get")
    assert (state["is_grasped"], state["calibrated"], state["opening_mm"]) == (True, False, None)
    assert state["loss_detection"] is True
    client.result("motion.set_force", force_n=20.0, calibration=calibration)
    world.run(1.5)
    assert world.torque_nm == pytest.approx(2.0, abs=0.1)
    assert client.result("motion.move", opening_mm=60.0, calibration=calibration)["ok"]
    assert client.result("motion.close", calibration=calibration)["stalled"]
    assert client.refusal("motion.close") == "not_calibrated"


def test_a_recording_a_replay_and_teleoperation_go_by_it() -> None:
    world, client = gripper()
    calibration = given()
    client.result("trajectory.record_start", calibration=calibration)
    world.run(0.5)
    recorded = client.result("trajectory.record_stop", name="taught")
    assert recorded["rad_to_mm"] == pytest.approx(MM_RAD)
    assert client.refusal("trajectory.play", name="taught") == "not_calibrated"
    assert client.result("trajectory.play", name="taught", calibration=calibration)["ok"]
    follow = {"mode": "slave", "fake_leader": True}
    assert client.refusal("teleop.start", **follow) == "teleop_not_ready"
    assert client.result("teleop.start", **follow, calibration=calibration)["active"]
    world.run(1.0)
    assert client.result("teleop.status")["active"]
    client.result("teleop.stop")


def test_a_recording_by_it_ends_when_another_calibration_is_taken() -> None:
    world, client = gripper(calibrated=True)
    narrow = given(max_position_rad=-1.5)
    client.result("trajectory.record_start", zero_gravity=False, calibration=narrow)
    world.run(0.3)
    assert client.result("trajectory.status")["active"]
    client.result("calibration.load", content=given(max_position_rad=-1.6))
    world.run(0.1)
    assert client.result("trajectory.status")["error"] == "another calibration was taken"


def test_it_changes_nothing_for_other_motions_and_clients() -> None:
    world, client = gripper(calibrated=True)
    other = world.client()
    before = other.result("calibration.get")
    half = given(rad_to_mm=MM_RAD * 0.9, work_stroke_mm=40.0, kp=60.0, kd=1.0)
    opened = client.result("motion.open", calibration=half)
    assert opened["outcome"] == "reached"
    assert world.gripper.opening_mm == pytest.approx(40.0 / 0.9, abs=NEAR_MM)
    assert other.result("calibration.get") == before
    state = other.result("state.get")
    assert state["opening_mm"] == pytest.approx(world.gripper.opening_mm, abs=0.1)
    assert other.result("motion.move", opening_mm=40.0)["ok"]
    assert world.gripper.opening_mm == pytest.approx(40.0, abs=NEAR_MM)
    assert client.result("motion.open")["outcome"] == "pressed_home"
    assert other.result("calibration.get") == before


def test_its_gains_are_those_of_the_hold_that_it_leaves_until_the_next_motion() -> None:
    world, client = gripper(calibrated=True)
    own = world.controller.gains
    client.result("motion.zero_gravity")
    client.result("motion.hold", calibration=given(kp=60.0, kd=0.5))
    assert isinstance(world.controller.idle, Hold)
    assert (world.controller.idle.gains.kp_nm_rad, world.controller.gains) == (60.0, own)
    client.result("motion.zero_gravity")
    client.result("motion.hold")
    assert world.controller.idle.gains == own


def test_gains_that_it_leaves_out_are_the_grippers_own() -> None:
    world, client = gripper(calibrated=True)
    own = world.controller.gains
    client.result("motion.zero_gravity")
    client.result("motion.hold", calibration=given(kp=80.0))
    assert isinstance(world.controller.idle, Hold)
    gains = world.controller.idle.gains
    assert (gains.kp_nm_rad, gains.kd_nm_s_rad) == (80.0, own.kd_nm_s_rad)


def test_a_hold_in_force_is_not_moved_by_it() -> None:
    """The stop is elastic: with other limits in force, pressed jaws would spring back."""
    world, client = gripper(calibrated=True)
    assert client.result("motion.close")["outcome"] == "pressed_home"
    world.run(2.0)
    idle, in_force = world.controller.idle, world.controller.in_force
    at_rad = world.gripper.position_rad
    client.result("motion.hold", calibration=given(zero_position_rad=-0.1))
    world.run(1.0)
    assert (world.controller.idle, world.controller.in_force) == (idle, in_force)
    assert world.gripper.position_rad == pytest.approx(at_rad, abs=1e-3)


def test_a_grip_keeps_what_it_began_with() -> None:
    world, client = gripper(calibrated=True, width_mm=30.0)
    client.result("motion.grasp", force_n=10.0, until="verdict", calibration=given())
    grip = world.controller.grip
    assert isinstance(grip, Grip)
    blocked = client.result("motion.close", calibration=given("reverse"))
    assert blocked["ok"] is False
    assert world.controller.grip is grip
    world.run(0.5)
    assert world.state.is_grasped


def test_the_force_per_torque_is_the_grippers_own() -> None:
    world, client = gripper(calibrated=True, width_mm=30.0)
    client.result("calibration.load", content=given(nm_to_n=20.0))
    client.result("motion.grasp", force_n=20.0, until="verdict", calibration=given())
    world.run(2.0)
    assert world.torque_nm == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("wrong", "reason", "names"),
    [
        ({"rad_to_mm": 1e9}, "calibration_unreadable", "rad_to_mm"),
        ({"rad_to_mm": 0.0}, "calibration_unreadable", "rad_to_mm"),
        ({"rad_to_mm": -52.69}, "calibration_unreadable", "rad_to_mm"),
        ({"rad_to_mm": 200.0}, "calibration_unreadable", "stroke"),
        ({"rad_to_mm": 10**400}, "calibration_unreadable", "rad_to_mm"),
        ({"rad_to_mm": "52.69"}, "calibration_unreadable", "rad_to_mm"),
        ({"rad_to_mm": True}, "calibration_unreadable", "rad_to_mm"),
        ({"max_position_rad": -94.6, "rad_to_mm": 0.92}, "calibration_unreadable", "degrees"),
        ({"max_position_rad": 0.0}, "calibration_unreadable", "equal"),
        ({"kp": 0.0}, "calibration_unreadable", "kp"),
        ({"kp": 501.0}, "calibration_unreadable", "kp"),
        ({"kd": -0.1}, "calibration_unreadable", "kd"),
        ({"kd": 5.1}, "calibration_unreadable", "kd"),
        ({"work_stroke_mm": -1.0}, "calibration_unreadable", "work_stroke_mm"),
        ({"nm_to_n": 19.0}, "invalid_params", ", ".join(GIVEN_KEYS)),
        ({"calibrated": True}, "invalid_params", ", ".join(GIVEN_KEYS)),
    ],
)
@pytest.mark.parametrize("calibrated", [False, True])
def test_what_no_file_may_hold_moves_nothing(
    calibrated: bool, wrong: dict[str, Any], reason: str, names: str
) -> None:
    world, client = gripper(calibrated=calibrated)
    before = client.result("calibration.get")
    for method, needed in (("motion.close", {}), ("stream.set", {"openness": 0.0})):
        answer = client.call(method, **needed, calibration=given(**wrong))["error"]
        assert (answer["data"]["reason"], names in answer["message"]) == (reason, True), answer
    world.run(0.3)
    assert world.gripper.opening_mm == pytest.approx(60.0, abs=0.1)
    assert client.result("calibration.get") == before
    loadable = {**given(), **wrong}
    if reason == "calibration_unreadable":
        assert client.refusal("calibration.load", content=loadable) == reason


@pytest.mark.parametrize("missing", GIVEN_KEYS[:3])
def test_limits_and_scale_are_required(missing: str) -> None:
    _world, client = gripper(calibrated=True)
    calibration = given()
    del calibration[missing]
    answer = client.call("motion.close", calibration=calibration)["error"]
    assert answer["data"]["reason"] == "calibration_unreadable"
    assert f"{missing} is missing" in answer["message"]


def test_limits_far_from_where_the_jaws_are_move_nothing() -> None:
    world, client = gripper()
    away = given(zero_position_rad=6.0, max_position_rad=4.4)
    assert client.refusal("motion.close", calibration=away) == "out_of_limits"
    assert client.refusal("stream.set", openness=0.0, calibration=away) == "out_of_limits"
    world.run(0.2)
    assert world.gripper.opening_mm == pytest.approx(60.0, abs=0.1)


def test_swapped_limits_only_swap_the_words_and_press_no_harder() -> None:
    """As with a file of the wrong mount: `close` opens, and ends at the stop without harm."""
    world, client = gripper(calibrated=True)
    swapped = given(zero_position_rad=NOMINAL[0].open_rad, max_position_rad=NOMINAL[0].closed_rad)
    number = client.send("motion.close", calibration=swapped)
    hardest_nm = max(client.track(number, lambda: world.torque_nm))
    assert client.answers[number]["result"]["outcome"] == "pressed_home"
    assert world.gripper.opening_mm == pytest.approx(NOMINAL[0].travel_mm, abs=NEAR_MM)
    assert hardest_nm < 2.1


def test_a_doubtful_scale_is_taken_and_told_once_for_a_session() -> None:
    world, client = gripper(calibrated=True)
    while world.service.take_events():
        pass
    doubtful = given(rad_to_mm=SUPERSEDED_MM_RAD)
    client.result("events.subscribe")
    stream(world, client, 0.5, openness=0.5, calibration=doubtful)
    stream(world, client, 0.2, openness=0.5, calibration=given())
    stream(world, client, 0.5, openness=0.5, calibration=doubtful)
    world.run(0.3)
    client.result("motion.open", calibration=doubtful)
    (told,) = client.events("calibration")
    assert told["data"]["warning"] is True
    assert "120 mm" in told["message"]
    assert "85 mm" in told["message"]


def test_a_stream_whose_calibration_changes_goes_by_the_latest() -> None:
    world, client = gripper()
    stream(world, client, 1.0, opening_mm=40.0, calibration=given())
    assert world.gripper.opening_mm == pytest.approx(40.0, abs=NEAR_MM)
    stream(world, client, 1.0, opening_mm=40.0, calibration=given(rad_to_mm=MM_RAD * 0.9))
    assert world.gripper.opening_mm == pytest.approx(40.0 / 0.9, abs=NEAR_MM)
    assert [job.kind for job in world.controller.jobs].count("stream") == 1
    assert client.refusal("stream.set", opening_mm=40.0) == "not_calibrated"


def test_a_stream_does_not_change_to_limits_in_which_no_jaw_can_be() -> None:
    world, client = gripper(calibrated=True)
    stream(world, client, 0.5, opening_mm=50.0)
    away = given(zero_position_rad=6.0, max_position_rad=4.4)
    for params in ({"opening_mm": 50.0}, {"push_nm": 1.0}):
        assert client.refusal("stream.set", **params, calibration=away) == "out_of_limits"
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=NEAR_MM)


def test_a_queued_motion_goes_by_its_own_when_its_turn_comes() -> None:
    world, client = gripper()
    moved = client.send("motion.move", opening_mm=40.0, calibration=given())
    half = given(work_stroke_mm=70.0)
    queued = client.send("motion.open", if_busy="queue", calibration=half)
    client.wait(queued)
    assert client.answers[moved]["result"]["ok"]
    assert client.answers[queued]["result"]["outcome"] == "reached"
    assert world.gripper.opening_mm == pytest.approx(70.0, abs=NEAR_MM)
    client.send("motion.move", opening_mm=40.0, calibration=given())
    refused = client.send("motion.open", if_busy="queue")
    assert client.wait(refused)["error"]["data"]["reason"] == "not_calibrated"
