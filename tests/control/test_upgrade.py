"""A configuration and files of a version that took the travel for 120 mm."""

from dataclasses import replace
from typing import Any

import pytest

from litegripd.model.calibration import SUPERSEDED, Calibration
from litegripd.model.gripper import SPAN_INSET_MM, STROKE_MM, Geometry
from tests.world import Client, World

TRUE_TRAVEL_RAD = 1.651026
OLD_ZERO = Geometry(0.0, -TRUE_TRAVEL_RAD, 120.0 / TRUE_TRAVEL_RAD)
"""What `zero` of such a version has saved for the gripper that ships."""


def upgraded(geometry: Geometry = OLD_ZERO) -> tuple[World, Client]:
    world = World()
    world.controller.use_calibration(Calibration(geometry), file="/var/lib/can0_calibration.json")
    return world, world.enabled()


def fastest_rad_s(world: World, client: Client, method: str, **params: Any) -> float:
    """Return the motor's highest true speed during a motion."""
    number = client.send(method, **params)
    fastest = max(client.track(number, lambda: abs(world.gripper.velocity_rad_s)))
    assert "result" in client.answers[number], client.answers[number]
    return fastest


@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
def test_with_an_old_file_nothing_moves_faster_than_it_did(method: str) -> None:
    world, client = upgraded()
    was_rad_s = 50.0 / OLD_ZERO.rad_to_mm
    assert 0.9 * was_rad_s < fastest_rad_s(world, client, method) <= 1.15 * was_rad_s


def test_with_an_old_file_nothing_moves_further_than_it_did() -> None:
    world, client = upgraded()
    client.result("motion.move", opening_mm=60.0)
    assert world.gripper.position_rad == pytest.approx(-60.0 / OLD_ZERO.rad_to_mm, abs=0.02)


@pytest.mark.parametrize("geometry", [OLD_ZERO, *SUPERSEDED])
def test_an_old_scale_is_said_where_people_look(geometry: Geometry) -> None:
    _, client = upgraded(geometry)
    assert client.result("state.get")["scale_doubt"] == "superseded"
    warning = client.result("calibration.get")["scale_warning"]
    assert f"{geometry.travel_mm:.4g} mm" in warning
    assert "85 mm" in warning
    assert "calibration.rescale corrects it" in warning


def test_one_command_corrects_it_and_moves_nothing() -> None:
    world, client = upgraded()
    before_rad = world.gripper.position_rad
    answer = client.result("calibration.rescale")
    world.run(0.5)
    assert abs(world.gripper.position_rad - before_rad) < 1e-4
    assert answer["rad_to_mm"] == pytest.approx((STROKE_MM + SPAN_INSET_MM) / TRUE_TRAVEL_RAD)
    assert (answer["closed_rad"], answer["open_rad"]) == (OLD_ZERO.closed_rad, OLD_ZERO.open_rad)
    assert answer["scale_warning"] is None
    assert client.result("state.get")["scale_doubt"] is None
    client.result("calibration.save")
    saved = world.disk.saved["calibration.save"]["content"]
    assert saved["rad_to_mm"] == answer["rad_to_mm"]


def test_the_measured_stroke_counts_where_it_is_given() -> None:
    _, client = upgraded()
    answer = client.result("calibration.rescale", stroke_mm=86.0)
    assert answer["rad_to_mm"] == pytest.approx((86.0 + SPAN_INSET_MM) / TRUE_TRAVEL_RAD)
    assert client.refusal("calibration.rescale", stroke_mm=120.0) == "out_of_limits"
    assert client.result("calibration.get")["rad_to_mm"] == answer["rad_to_mm"]


def test_the_gripper_that_was_never_measured_keeps_its_limits() -> None:
    world, client = upgraded(SUPERSEDED[0])
    file = replace(Calibration(SUPERSEDED[0]), calibrated=False)
    world.controller.use_calibration(file)
    assert client.refusal("calibration.rescale") == "not_calibrated"
