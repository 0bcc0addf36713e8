"""Calibrating by probing: what it measures, how gently, and that nothing changes when it fails."""

import json
from typing import Any

import pytest

from litegripd.model.calibration import NOMINAL, read_content
from litegripd.model.gripper import SPAN_INSET_MM, STROKE_MM
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import ZeroView
from litegripd.motor import codec
from litegripd.sim.plant import limits_of_mount
from tests.control.limits import LimitWatch
from tests.world import CAN_ID, Client, World, is_command, ready

MOUNTS = ("normal", "reverse")
CONFIG = MotionConfig()
FAST = {"calib_kd": 0.6}
TRAVEL_RAD, TRAVEL_MM = NOMINAL[0].travel_rad, NOMINAL[0].travel_mm
SPAN_MM = STROKE_MM + SPAN_INSET_MM
KEYS = {
    "channel",
    "can_id",
    "mst_id",
    "canfd_mode",
    "calibrated",
    "zero_position_rad",
    "max_position_rad",
    "travel_range_rad",
    "rad_to_mm",
    "motor_type",
    "kp",
    "kd",
    "grasp_torque_threshold",
}


def gripper(
    mount: str = "normal", *, opening_mm: float = 60.0, calibrated: bool = True
) -> tuple[World, Client]:
    return ready(mount, calibrated, initial_opening_mm=opening_mm)


def watched(world: World, client: Client, *, most: float = 1.0, **params: Any) -> dict[str, Any]:
    """Calibrate, with an eye on every command; return the result."""
    watch, strongest_nm = LimitWatch(world.controller), 0.0
    number = client.send("calibration.zero", **params)
    action = world.controller.action
    while not client.has_answer(number):
        watch.begin()
        world.tick()
        feedback, is_on = world.controller.motor.feedback, world.controller.action is action
        frames = [sent.frame for sent in world.sent_since(world.now_s)]
        commands = [f.data for f in frames if f.can_id == CAN_ID and is_command(f)]
        command = codec.decode_command(commands[-1], world.ranges)
        watch.check(world.now_s, command, feedback, world.ranges, is_motion=is_on, in_codes=True)
        if is_on:
            strongest_nm = max(strongest_nm, world.torque_nm)
    ceiling_nm = params.get("config", {}).get("calib_tau_limit", CONFIG.calib_tau_limit)
    assert strongest_nm <= most * ceiling_nm + 0.05
    result: dict[str, Any] = client.answers[number]["result"]
    return result


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("opening_mm", [0.0, 60.0, TRAVEL_MM])
def test_it_measures_the_travel(mount: str, opening_mm: float) -> None:
    world, client = gripper(mount, opening_mm=opening_mm)
    result = watched(world, client)
    assert (result["ok"], result["outcome"], result["message"]) == (True, "measured", None)
    closed_rad, open_rad = limits_of_mount(mount)
    assert result["travel_rad"] == pytest.approx(TRAVEL_RAD, rel=0.01)
    assert result["rad_to_mm"] == pytest.approx(SPAN_MM / result["travel_rad"])
    assert result["closed_rad"] == pytest.approx(closed_rad, abs=0.01)
    assert result["open_rad"] == pytest.approx(open_rad, abs=0.01)
    assert result["state"]["mount"] == mount
    geometry = world.geometry
    assert (geometry.closed_rad, geometry.open_rad) == (result["closed_rad"], result["open_rad"])


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_jaws_do_not_stay_pressed_against_each_other(mount: str) -> None:
    world, client = gripper(mount)
    watched(world, client)
    world.run(0.5)
    assert 2.0 < world.gripper.opening_mm < 6.0
    assert world.torque_nm < 0.3
    assert world.state.mode == "holding"
    for method in ("motion.open", "motion.close"):
        assert client.result(method)["outcome"] == "pressed_home"


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    "config",
    [
        {"calib_kp": 40.0, "calib_kd": 2.5},
        {"calib_step_rad": 0.025, "calib_kp": 40.0, "calib_tau_limit": 1.1},
        {"sample_interval": 0.02, "calib_stall_cycles": 12, "calib_max_iter": 2000},
    ],
)
def test_it_is_as_gentle_with_other_settings(mount: str, config: dict[str, float]) -> None:
    world, client = gripper(mount)
    result = watched(world, client, config=config, most=1.5)  # late speed brakes late
    assert result["outcome"] == "measured"
    assert result["travel_rad"] == pytest.approx(TRAVEL_RAD, rel=0.03)  # the ends are soft


@pytest.mark.parametrize("mount", MOUNTS)
def test_an_uncalibrated_gripper_needs_to_be_told_its_mount(mount: str) -> None:
    world, client = gripper(mount, calibrated=False)
    assert client.refusal("calibration.zero") == "not_calibrated"
    result = watched(world, client, mount=mount)
    assert (result["ok"], result["state"]["mount"]) == (True, mount)
    assert result["travel_rad"] == pytest.approx(TRAVEL_RAD, rel=0.01)
    assert client.result("motion.open")["outcome"] == "pressed_home"


def test_the_file_has_the_keys_of_the_vendors_sdk() -> None:
    world, client = gripper()
    result = watched(world, client)
    saved = world.disk.saved["calibration.save"]
    content = saved["content"]
    assert result["path"] == "/state/calibration.save"
    assert (saved["channel"], content) == (world.controller.gripper_id.channel, result["content"])
    assert content.keys() == KEYS
    assert json.loads(json.dumps(content)) == content
    assert content["zero_position_rad"] == result["closed_rad"]
    assert content["max_position_rad"] == result["open_rad"]
    assert content["travel_range_rad"] == result["travel_rad"]
    assert content["rad_to_mm"] == result["rad_to_mm"]
    assert (content["can_id"], content["mst_id"], content["calibrated"]) == (0x08, 0x18, True)
    assert (content["kp"], content["kd"], content["motor_type"]) == (100.0, 2.0, "DM4310")
    known = client.result("calibration.get")
    assert (known["file"], known["content"]) == (result["path"], content)


def test_what_a_file_held_besides_is_kept() -> None:
    world, client = gripper()
    before = {
        "zero_position_rad": 0.1,
        "max_position_rad": -1.4,
        "rad_to_mm": 80.0,
        "kp": 55.0,
        "note": {"by": "hand"},
        "channel": "can7",
    }
    world.controller.use_calibration(read_content(before), file="/old")
    content = watched(world, client)["content"]
    assert (content["note"], content["kp"], content["kd"]) == ({"by": "hand"}, 55.0, 2.0)
    assert content["channel"] == world.controller.gripper_id.channel
    assert world.controller.gains.kp_nm_rad == 55.0


def test_it_need_not_be_saved() -> None:
    world, client = gripper()
    result = watched(world, client, save=False)
    assert (result["ok"], result["path"]) == (True, None)
    assert result["content"].keys() == KEYS
    assert world.disk.saved == {}
    assert client.result("calibration.get")["file"] is None
    geometry = world.geometry
    assert geometry.closed_rad == result["closed_rad"]


def test_nothing_else_runs_meanwhile_and_no_calibration_is_loaded() -> None:
    world, client = gripper()
    number = client.send("calibration.zero")
    world.run(0.5)
    for method, params in (
        ("motion.open", {}),
        ("stream.set", {"opening_mm": 10.0}),
        ("calibration.load", {"template": "reverse"}),
        ("calibration.manual", {"step": "begin"}),
        ("motor.set_zero", {}),
    ):
        assert world.client().refusal(method, **params) == "busy"
    assert client.wait(number)["result"]["ok"]


def test_progress_tells_the_phases() -> None:
    _world, client = gripper()
    number = client.send("calibration.zero", progress=True)
    client.wait(number)
    reports = client.told("job.progress")
    phases = [report["phase"] for report in reports]
    seen = sorted(set(phases), key=phases.index)
    assert seen[:4] == ["probe_open", "probe_closed", "confirm_open", "confirm_closed"]
    assert set(seen[4:]) <= {"back_off", "saving"}
    assert all(report["total_steps"] == 0 for report in reports)


def test_a_motion_ends_when_nobody_knows_any_more_where_the_zero_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World()
    client, motor = world.enabled(), world.machine.motor
    number = client.send("motion.open")
    world.run(0.2)
    view = motor.view
    zero = ZeroView("pending", is_uncertain=True)
    monkeypatch.setattr(motor, "view", lambda: view()._replace(zero=zero))
    world.run(0.05)
    assert client.has_answer(number)
    assert client.answers[number]["error"]["data"]["reason"] == "not_calibrated"
    held_rad = world.gripper.position_rad
    world.run(0.5)
    assert world.gripper.position_rad == pytest.approx(held_rad, abs=0.02)
    assert client.refusal("motion.close") == "not_calibrated"


def test_what_it_presses_with_at_the_stops_is_no_obstacle() -> None:
    world, client = gripper(opening_mm=TRAVEL_MM - 1.0)
    client.result("events.subscribe")
    result = watched(world, client, config={"calib_stall_cycles": 60})  # three seconds at a stop
    assert result["ok"]
    assert [event["message"] for event in client.events("pressing")] == []
