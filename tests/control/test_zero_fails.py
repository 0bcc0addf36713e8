"""Calibrating by probing that does not succeed: nothing has changed, and the jaws are held."""

import pytest

from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from tests.control.test_zero import FAST, MOUNTS, gripper, watched
from tests.world import World


def in_use(world: World) -> tuple[Calibration | None, str | None, Refusal]:
    known = world.controller.calibrated
    return known.calibration, known.file, known.problem


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("width_mm", [35.0, 55.0])
def test_something_between_the_jaws_changes_nothing(mount: str, width_mm: float) -> None:
    world, client = gripper(mount)
    world.gripper.put_object(width_mm=width_mm)
    before = in_use(world)
    result = watched(world, client)
    assert (result["ok"], result["outcome"]) == (False, "implausible_travel")
    assert "rad apart" in result["message"]
    assert (result["travel_rad"], result["content"], result["path"]) == (None, None, None)
    assert in_use(world) == before
    assert world.disk.saved == {}
    world.run(0.5)
    assert world.torque_nm < 0.3


def test_a_stop_that_is_not_met_in_time_changes_nothing() -> None:
    world, client = gripper()
    before = in_use(world)
    result = watched(world, client, config={"calib_max_iter": 10})
    assert (result["ok"], result["outcome"]) == (False, "not_found")
    assert "open stop" in result["message"]
    assert "calib_max_iter" in result["message"]
    assert in_use(world) == before
    assert world.disk.saved == {}
    world.run(0.3)
    assert abs(world.gripper.velocity_rad_s) < 0.01


@pytest.mark.parametrize("calibrated", [True, False])
def test_a_file_that_cannot_be_written_changes_nothing(calibrated: bool) -> None:
    world, client = gripper(calibrated=calibrated)
    before = in_use(world)
    world.disk.error = "no space left on the device"
    result = watched(world, client, mount="normal")
    assert (result["ok"], result["outcome"]) == (False, "not_saved")
    assert "no space left" in result["message"]
    assert in_use(world) == before
    assert client.result("calibration.get")["calibrated"] is calibrated


def test_a_helper_that_does_not_answer_is_not_waited_for_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world, client = gripper()
    before = in_use(world)
    monkeypatch.setattr(world, "_send_tasks", lambda: None)
    result = client.result("calibration.zero", config=FAST)
    assert (result["ok"], result["outcome"]) == (False, "not_saved")
    assert in_use(world) == before
    (task,) = world.controller.tasks
    task.on_result(world.disk.do(task))  # too late
    world.run(0.1)
    assert in_use(world) == before


@pytest.mark.parametrize(
    "phase",
    ["probe_open", "probe_closed", "confirm_open", "confirm_closed", "back_off", "saving"],
)
@pytest.mark.parametrize("end", ["cancel", "stop", "relax", "disable", "leave", "fault"])
def test_ended_early_in_any_phase_it_changes_nothing(phase: str, end: str) -> None:
    world, client = gripper()
    before = in_use(world)
    client.send("calibration.zero", config=FAST)
    world.run_until(lambda: world.state.job is not None and world.state.job.phase == phase)
    if phase.startswith(("probe", "confirm")):
        world.run(0.2)
    job = world.running
    if end == "cancel":
        world.client().result("job.cancel", job=job.number)
    elif end == "leave":
        client.leave()
    elif end == "fault":
        world.gripper.set_supply(40.0)
    else:
        world.client().result("stop", level="hold" if end == "stop" else end)
    here_rad = world.gripper.position_rad
    world.run(0.5)
    assert not job.is_running
    assert job.error is not None or (phase, end) == ("saving", "fault")
    if (phase, end) != ("saving", "fault"):  # the motor says so when all is done
        assert in_use(world) == before
    if phase != "saving":
        assert world.disk.saved == {}
    if end in ("cancel", "stop", "leave"):
        assert world.state.mode == "holding"
        assert world.gripper.position_rad == pytest.approx(here_rad, abs=0.05)
        assert world.torque_nm <= 1.1
    else:
        assert world.torque_nm <= 0.01


def test_it_is_refused_where_no_motion_may_begin() -> None:
    world = World().start()
    client = world.client()
    assert client.refusal("calibration.zero") == "not_enabled"
    client.result("motor.enable")
    client.send("motion.open")
    world.run(0.1)
    assert client.refusal("calibration.zero") == "busy"
    client.result("stop")
    assert client.refusal("calibration.zero") == "stopped"
    client.result("stop.clear")
    config = {"calib_kp": 100.5}
    answer = client.call("calibration.zero", config=config)
    assert answer["error"]["data"]["reason"] == "invalid_params"
    assert answer["error"]["data"]["field"] == "calib_kp"
    assert world.controller.jobs.running is None
