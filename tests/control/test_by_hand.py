"""Calibrating by hand: slack jaws, two marks, and every step out of order refused."""

from typing import Any

import pytest

from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import SPAN_INSET_MM, STROKE_MM
from litegripd.model.motor import MotorPhase
from litegripd.sim.plant import limits_of_mount
from tests.control.states import is_slack
from tests.world import Client, World, ready

MOUNTS = ("normal", "reverse")
FAR_ENOUGH_MM = 0.5
SPAN_MM = STROKE_MM + SPAN_INSET_MM


def begun(mount: str = "normal", *, calibrated: bool = True) -> tuple[World, Client]:
    world, client = ready(mount, calibrated=calibrated)
    result = client.result("calibration.manual", step="begin")
    assert world.controller.jobs.running is not None
    assert world.controller.jobs.running.number == result["job"]
    world.run(0.05)
    return world, client


def push_to(world: World, side: str) -> None:
    """Push the jaws by hand until they rest at a stop, pressed as a probe would."""
    sign = world.gripper.parameters.close_sign * (1 if side == "closed" else -1)
    world.gripper.push(sign * 2.0)
    end_mm = FAR_ENOUGH_MM if side == "closed" else NOMINAL[0].travel_mm - FAR_ENOUGH_MM
    world.run_until(lambda: abs(world.gripper.opening_mm - end_mm) < 1.0)
    world.gripper.push(sign * 0.94)
    world.run(0.3)


def mark(client: Client, side: str) -> dict[str, Any]:
    push_to(client.world, side)
    return client.result("calibration.manual", step=side)


def refusal(client: Client, step: str) -> str:
    return client.refusal("calibration.manual", step=step)


def in_use(world: World) -> tuple[Calibration | None, str | None]:
    return world.controller.calibrated.calibration, world.controller.calibrated.file


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("first", ["closed", "open"])
def test_two_marks_make_a_calibration(mount: str, calibrated: bool, first: str) -> None:
    world, client = begun(mount, calibrated=calibrated)
    marks = mark(client, first)
    assert marks[f"{first}_rad"] == pytest.approx(world.gripper.position_rad, abs=1e-3)
    second = "open" if first == "closed" else "closed"
    assert marks[f"{second}_rad"] is None
    marks = mark(client, second)
    result = client.result("calibration.manual", step="finish")
    assert (result["ok"], result["outcome"]) == (True, "measured")
    assert (result["closed_rad"], result["open_rad"]) == (marks["closed_rad"], marks["open_rad"])
    assert result["travel_rad"] == pytest.approx(NOMINAL[0].travel_rad, rel=0.01)
    # Two marks are pressed as a probe presses: 1 mm into the open stop.
    assert result["rad_to_mm"] == pytest.approx(SPAN_MM / result["travel_rad"])
    assert result["state"]["mount"] == mount
    assert result["path"] == "/state/calibration.save"
    assert world.disk.saved["calibration.save"]["content"] == result["content"]
    assert result["content"]["zero_position_rad"] == marks["closed_rad"]
    world.gripper.push(0.0)
    world.run(0.3)
    assert world.state.mode == "holding"
    assert client.result("motion.open")["outcome"] == "pressed_home"


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_marks_alone_say_which_way_closing_runs(mount: str) -> None:
    """The calibration in use says the opposite."""
    world = World(mount)
    other = limits_of_mount("reverse" if mount == "normal" else "normal")
    client = world.enabled()
    limits = {"zero_position_rad": other[0], "max_position_rad": other[1]}
    content = {**limits, "rad_to_mm": NOMINAL[0].rad_to_mm}
    assert client.result("calibration.load", content=content)["mount"] != mount
    client.result("calibration.manual", step="begin")
    world.run(0.05)
    mark(client, "closed")
    mark(client, "open")
    assert client.result("calibration.manual", step="finish")["state"]["mount"] == mount


def test_the_jaws_are_slack_all_the_while() -> None:
    world, client = begun()
    since_s = world.now_s
    mark(client, "closed")
    mark(client, "open")
    for _, command in world.commands_since(since_s):
        assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0
        assert abs(command.torque_nm) < 0.003
    client.result("calibration.manual", step="finish")
    world.run(0.05)
    assert not is_slack(world)


def test_a_mark_may_be_made_anew() -> None:
    _, client = begun()
    first = client.result("calibration.manual", step="closed")["closed_rad"]
    mark(client, "closed")
    marks = mark(client, "open")
    assert marks["closed_rad"] != first
    assert client.result("calibration.manual", step="finish")["closed_rad"] == marks["closed_rad"]


def test_it_need_not_be_saved() -> None:
    world, client = begun()
    mark(client, "closed")
    mark(client, "open")
    result = client.result("calibration.manual", step="finish", save=False)
    assert (result["ok"], result["path"]) == (True, None)
    assert world.disk.saved == {}
    assert in_use(world)[1] is None


@pytest.mark.parametrize("step", ["closed", "open", "finish", "cancel"])
def test_nothing_goes_before_it_has_begun(step: str) -> None:
    world, client = ready()
    before = in_use(world)
    assert refusal(client, step) == "not_calibrated"
    client.send("motion.open")
    world.run(0.1)
    assert refusal(client, step) == "not_calibrated"
    assert world.state.mode == "moving"
    assert in_use(world) == before


def test_it_begins_once() -> None:
    world, client = begun()
    assert refusal(client, "begin") == "busy"
    assert refusal(world.client(), "begin") == "busy"
    client.result("calibration.manual", step="cancel")
    client.result("calibration.manual", step="begin")


@pytest.mark.parametrize("marked", [(), ("closed",), ("open",)])
def test_it_is_not_finished_before_both_stops_are_marked(marked: tuple[str, ...]) -> None:
    world, client = begun()
    before = in_use(world)
    for side in marked:
        mark(client, side)
    answer = client.call("calibration.manual", step="finish")
    assert answer["error"]["data"]["reason"] == "out_of_limits"
    assert "not marked yet" in answer["error"]["message"]
    assert in_use(world) == before
    assert world.controller.jobs.running is not None  # the missing mark may be made
    for side in {"closed", "open"}.difference(marked):
        mark(client, side)
    assert client.result("calibration.manual", step="finish")["ok"]


def test_marks_in_one_place_are_no_travel() -> None:
    world, client = begun()
    before = in_use(world)
    client.result("calibration.manual", step="closed")
    client.result("calibration.manual", step="open")
    assert refusal(client, "finish") == "out_of_limits"
    assert in_use(world) == before
    mark(client, "closed")
    mark(client, "open")
    assert client.result("calibration.manual", step="finish")["ok"]


@pytest.mark.parametrize("step", ["closed", "open", "finish", "cancel"])
def test_another_client_has_no_part_in_it(step: str) -> None:
    world, client = begun()
    mark(client, "closed")
    mark(client, "open")
    assert refusal(world.client(), step) == "busy"
    assert client.result("calibration.manual", step="finish")["ok"]


@pytest.mark.parametrize("step", ["closed", "finish"])
def test_while_it_is_saved_nothing_changes_it(step: str) -> None:
    _world, client = begun()
    mark(client, "closed")
    marks = mark(client, "open")
    number = client.send("calibration.manual", step="finish")
    assert refusal(client, step) == "busy"
    assert client.wait(number)["result"]["closed_rad"] == marks["closed_rad"]
    assert refusal(client, "finish") == "not_calibrated"


@pytest.mark.parametrize("end", ["cancel", "job.cancel", "stop", "leave", "fault"])
@pytest.mark.parametrize("marks", [0, 2])
def test_given_up_it_changes_nothing(end: str, marks: int) -> None:
    world, client = begun()
    before = in_use(world)
    for side in ("closed", "open")[:marks]:
        mark(client, side)
    world.gripper.push(0.0)
    job = world.running
    if end == "cancel":
        assert client.result("calibration.manual", step="cancel") == {}
    elif end == "job.cancel":
        world.client().result("job.cancel", job=job.number)
    elif end == "stop":
        world.client().result("stop")
    elif end == "leave":
        client.leave()
    else:
        world.gripper.set_supply(40.0)
    world.run(0.3)
    assert not job.is_running
    assert job.error is not None
    assert in_use(world) == before
    assert world.disk.saved == {}
    if end == "fault":
        assert world.phase is MotorPhase.FAULT
    else:
        assert world.state.mode == "holding"
        assert world.torque_nm < 0.3


def test_a_file_that_cannot_be_written_changes_nothing() -> None:
    world, client = begun()
    before = in_use(world)
    mark(client, "closed")
    mark(client, "open")
    world.disk.error = "no space left on the device"
    result = client.result("calibration.manual", step="finish")
    assert (result["ok"], result["outcome"]) == (False, "not_saved")
    assert "no space left" in result["message"]
    assert in_use(world) == before
    assert world.controller.jobs.running is None


def test_progress_tells_how_many_stops_are_marked() -> None:
    world, client = begun()
    seen = []
    for side in ("closed", "open"):
        mark(client, side)
        progress = world.controller.progress()
        assert progress is not None
        seen.append((progress.phase, progress.step, progress.total_steps))
    assert seen == [("by_hand", 1, 2), ("by_hand", 2, 2)]
    client.send("calibration.manual", step="finish")
    assert world.state.job is not None
    assert world.state.job.phase == "saving"
