"""The millimetres of a calibration: by a stroke that a caliper measured, or corrected later."""

import struct
from dataclasses import replace
from typing import Any

import pytest

from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import SPAN_INSET_MM, STROKE_MM, Geometry
from tests.control.test_by_hand import begun, mark
from tests.motor.helpers import set_register
from tests.world import Client, World, ready

GEOMETRY = NOMINAL[0]
SPAN_MM = STROKE_MM + SPAN_INSET_MM
FARTHEST = (1.15 * SPAN_MM - SPAN_INSET_MM, 0.85 * SPAN_MM - SPAN_INSET_MM)
"""The strokes that differ by 15 %, which is just allowed."""
TOO_FAR = (FARTHEST[0] + 0.1, FARTHEST[1] - 0.1, 120.0, 8.5)


def measure(
    by: str, stroke_mm: float, *, calibrated: bool = True
) -> tuple[World, Client, dict[str, Any]]:
    """Measure the travel, and return the whole answer."""
    if by == "zero":
        world, client = ready(calibrated=calibrated)
        params: dict[str, Any] = {} if calibrated else {"mount": "normal"}
        answer = client.call("calibration.zero", 60.0, stroke_mm=stroke_mm, **params)
        return world, client, answer
    world, client = begun()
    mark(client, "closed")
    mark(client, "open")
    return world, client, client.call("calibration.manual", step="finish", stroke_mm=stroke_mm)


@pytest.mark.parametrize("by", ["zero", "hand"])
@pytest.mark.parametrize("stroke_mm", [STROKE_MM, 90.0, FARTHEST[0] - 1e-9, FARTHEST[1] + 1e-9])
def test_the_given_stroke_is_the_scale_of_the_measured_travel(by: str, stroke_mm: float) -> None:
    world, client, answer = measure(by, stroke_mm)
    result = answer["result"]
    assert (result["ok"], result["outcome"]) == (True, "measured")
    travel_rad = abs(result["open_rad"] - result["closed_rad"])
    assert result["travel_rad"] == pytest.approx(travel_rad)
    expected = (stroke_mm + SPAN_INSET_MM) / travel_rad
    assert result["rad_to_mm"] == pytest.approx(expected)
    geometry = world.geometry
    assert geometry.rad_to_mm == pytest.approx(expected)
    assert world.disk.saved["calibration.save"]["content"]["rad_to_mm"] == result["rad_to_mm"]
    assert client.result("calibration.get")["travel_mm"] == pytest.approx(stroke_mm + SPAN_INSET_MM)


@pytest.mark.parametrize("stroke_mm", TOO_FAR)
def test_no_jaw_moves_for_a_stroke_that_differs_too_much(stroke_mm: float) -> None:
    for calibrated in (True, False):
        world, _, answer = measure("zero", stroke_mm, calibrated=calibrated)
        before, here_rad = world.controller.calibrated.calibration, world.gripper.position_rad
        check_refusal(answer["error"], stroke_mm)
        assert world.controller.jobs.running is None
        world.run(0.5)
        assert world.gripper.position_rad == pytest.approx(here_rad, abs=1e-3)
        assert world.controller.calibrated.calibration is before
        assert world.disk.saved == {}


@pytest.mark.parametrize("stroke_mm", TOO_FAR)
def test_by_hand_such_a_stroke_is_refused_and_another_may_be_given(stroke_mm: float) -> None:
    world, client, answer = measure("hand", stroke_mm)
    check_refusal(answer["error"], stroke_mm)
    assert world.controller.jobs.running is not None
    assert world.controller.geometry == GEOMETRY
    assert world.disk.saved == {}
    assert client.result("calibration.manual", step="finish", stroke_mm=STROKE_MM)["ok"]


def check_refusal(error: dict[str, Any], stroke_mm: float) -> None:
    data = error["data"]
    assert (data["reason"], data["field"]) == ("out_of_limits", "stroke_mm")
    assert (data["requested"], data["limit"]) == (stroke_mm, STROKE_MM)
    assert "15%" in error["message"]
    assert "caliper" in error["message"]
    assert f"stroke_mm = {stroke_mm:g}" in error["message"]


@pytest.mark.parametrize("stroke_mm", [0.5, -85.0, 1001.0, "85"])
def test_what_no_gripper_has_is_no_stroke(stroke_mm: Any) -> None:
    world, client = ready()
    assert client.refusal("calibration.zero", stroke_mm=stroke_mm) == "invalid_params"
    assert client.refusal("calibration.rescale", stroke_mm=stroke_mm) == "invalid_params"
    assert world.controller.jobs.running is None


# Correcting it afterwards


def in_use(world: World) -> Calibration:
    calibration = world.controller.calibrated.calibration
    assert calibration is not None
    return calibration


def test_rescaling_keeps_limits_gains_and_all_else_and_moves_nothing() -> None:
    world, client = ready()
    content = {
        "zero_position_rad": GEOMETRY.closed_rad,
        "max_position_rad": GEOMETRY.open_rad,
        "rad_to_mm": GEOMETRY.rad_to_mm,
        "nm_to_n": 12.0,
        "kp": 5.0,
        "kd": 2.0,
        "work_stroke_mm": 70.0,
        "note": "mine",
    }
    client.result("calibration.load", content=content)
    client.result("motion.move", opening_mm=40.0)
    world.run(0.5)
    before, here_rad, since_s = in_use(world), world.gripper.position_rad, world.now_s
    held_rad = world.state.command_rad
    answer = client.result("calibration.rescale", stroke_mm=90.0)
    world.run(1.0)
    scale = 91.0 / GEOMETRY.travel_rad
    assert answer["rad_to_mm"] == pytest.approx(scale)
    rescaled = in_use(world)
    assert rescaled.geometry == replace(before.geometry, rad_to_mm=answer["rad_to_mm"])
    assert rescaled == replace(before, geometry=rescaled.geometry, saved_s=None)
    assert (answer["kp"], answer["kd"], answer["work_stroke_mm"]) == (5.0, 2.0, 70.0)
    assert (answer["content"]["note"], answer["content"]["nm_to_n"]) == ("mine", 12.0)
    assert world.gripper.position_rad == pytest.approx(here_rad, abs=1e-4)
    commanded = {command.position_rad for _, command in world.commands_since(since_s)}
    assert len(commanded) == 1
    assert world.state.command_rad == held_rad
    assert world.state.opening_mm == pytest.approx(
        (GEOMETRY.closed_rad - here_rad) * scale, abs=0.05
    )
    assert world.disk.saved == {}


def test_without_a_stroke_it_is_the_configured_one() -> None:
    world, client = ready()
    wrong = replace(GEOMETRY, rad_to_mm=1.1 * GEOMETRY.rad_to_mm)
    world.controller.use_calibration(Calibration(wrong), file="/mine")
    answer = client.result("calibration.rescale")
    assert answer["travel_mm"] == pytest.approx(SPAN_MM)
    assert answer["file"] == "/mine"
    client.result("calibration.save")
    saved = world.disk.saved["calibration.save"]["content"]
    assert saved["rad_to_mm"] == pytest.approx(SPAN_MM / GEOMETRY.travel_rad)
    assert client.result("calibration.rescale")["rad_to_mm"] == answer["rad_to_mm"]


@pytest.mark.parametrize("kind", ["motion.open", "calibration.zero", "motion.grasp"])
def test_it_is_refused_while_a_job_runs(kind: str) -> None:
    world, client = ready()
    world.gripper.put_object(width_mm=40.0)
    number = client.send(kind)
    world.run(0.3)
    before = in_use(world)
    assert client.refusal("calibration.rescale") == "busy"
    assert world.client().refusal("calibration.rescale") == "busy"
    assert in_use(world) is before
    assert not client.has_answer(number)


def test_without_a_calibration_there_is_nothing_to_correct() -> None:
    world, client = ready(calibrated=False)
    assert client.refusal("calibration.rescale") == "not_calibrated"
    unused = Calibration(Geometry(0.0, -1.6, 50.0), calibrated=False)
    world.controller.use_calibration(unused)
    assert client.refusal("calibration.rescale", stroke_mm=STROKE_MM) == "not_calibrated"
    assert in_use(world) is unused


@pytest.mark.parametrize("stroke_mm", TOO_FAR)
def test_too_different_a_stroke_corrects_nothing(stroke_mm: float) -> None:
    world, client = ready()
    before = in_use(world)
    error = client.call("calibration.rescale", stroke_mm=stroke_mm)["error"]
    assert error["data"]["reason"] == "out_of_limits"
    assert "15%" in error["message"]
    assert in_use(world) is before


def test_a_gripper_that_another_client_has_is_not_rescaled() -> None:
    world, client = ready()
    client.result("lease.acquire")
    assert world.client().refusal("calibration.rescale") == "lease_held"
    assert client.result("calibration.rescale")


@pytest.mark.parametrize("stroke_mm", [40.0, 110.0])
def test_a_template_takes_the_configured_stroke(stroke_mm: float) -> None:
    """Otherwise a gripper of another stroke could never be calibrated."""
    world = World(calibrated=False)
    world.controller.gripper_id = replace(world.controller.gripper_id, stroke_mm=stroke_mm)
    client = world.enabled()
    assert client.result("calibration.load", template="normal")["loaded"]
    assert client.result("calibration.get")["travel_mm"] == pytest.approx(stroke_mm + 1.0)
    assert client.result("calibration.zero", save=False)["ok"]
    assert client.result("calibration.get")["travel_mm"] == pytest.approx(stroke_mm + 1.0)


def test_limits_that_the_motor_cannot_report_are_given_up_once_it_is_known() -> None:
    world = World()
    set_register(world, 21, struct.pack("<f", 1.0))
    world.start()
    world.run(1.0)
    assert not world.state.calibrated
    problem = world.client().result("calibration.get")["problem"]
    assert "the motor reports at most ±1 rad" in problem
