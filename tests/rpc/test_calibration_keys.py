"""What a calibration file says besides limits and scale, and what of it survives a measurement.

Where `open` goes by it is tried in tests/control/test_work_stroke.py.
"""

from typing import Any

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import SPAN_INSET_MM, STROKE_MM
from litegripd.sim.plant import SimulatorParameters
from tests.world import Client, World, enabled_world, found_world

CONTENT: dict[str, Any] = {
    "zero_position_rad": NOMINAL[0].closed_rad,
    "max_position_rad": NOMINAL[0].open_rad,
    "rad_to_mm": NOMINAL[0].rad_to_mm,
}


def loaded(**keys: object) -> tuple[World, Client]:
    world, client = enabled_world()
    client.result("calibration.load", content={**CONTENT, **keys})
    world.tick()
    return world, client


@pytest.mark.parametrize(
    "wrong", [{"work_stroke_mm": -1.0}, {"nm_to_n": 4.9}, {"nm_to_n": 31}, {"nm_to_n": "19"}]
)
def test_what_they_cannot_be_is_refused_and_the_one_in_use_stays(wrong: dict[str, Any]) -> None:
    _, client = found_world()
    before = client.result("calibration.get")
    error = client.call("calibration.load", content=CONTENT | wrong)["error"]
    assert error["data"]["reason"] == "calibration_unreadable"
    assert next(iter(wrong)) in error["message"]
    assert client.result("calibration.get") == before


def test_a_measurement_its_file_and_a_new_scale_keep_them() -> None:
    world, client = loaded(work_stroke_mm=70.0, nm_to_n=19.0, note="mine")
    kept = {"work_stroke_mm": 70.0, "nm_to_n": 19.0, "note": "mine"}
    assert client.result("calibration.get")["work_stroke_mm"] == 70.0
    measured = client.result("calibration.zero")
    assert measured["ok"], measured
    saved = world.disk.saved["calibration.save"]["content"]
    rescaled = client.result("calibration.rescale", stroke_mm=80.0)["content"]
    client.result("calibration.save")
    for content in (
        measured["content"],
        saved,
        rescaled,
        world.disk.saved["calibration.save"]["content"],
    ):
        assert {key: content[key] for key in kept} == kept
    geometry = world.controller.geometry
    assert geometry is not None
    assert geometry.nm_to_n == 19.0
    assert geometry.travel_mm == pytest.approx(80.0 + SPAN_INSET_MM)


def test_the_force_of_a_grip_is_by_the_files_figure() -> None:
    world, client = loaded(nm_to_n=20.0)
    world.gripper.put_object(width_mm=30.0)
    client.result("motion.grasp", force_n=20.0, until="verdict")
    world.run(1.0)
    assert world.gripper.motor_torque_nm == pytest.approx(1.0, abs=0.05)
    assert world.state.force_set_n == 20.0


def test_a_force_beyond_what_a_grip_may_have_is_refused_with_the_most() -> None:
    _, client = loaded(nm_to_n=5.0)
    for method in ("motion.grasp", "motion.set_force"):
        error = client.call(method, force_n=21.0)["error"]
        assert (error["data"]["reason"], error["data"]["limit"]) == ("out_of_limits", 20.0)
        assert "with the calibration's 5 N per N·m it must be at most 20" in error["message"]


@pytest.mark.parametrize("travel_rad", [1.314183, 1.840238])
@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_units_that_were_seen_are_measured_after_a_template(mount: str, travel_rad: float) -> None:
    closed_rad, open_rad = (0.0, -travel_rad) if mount == "normal" else (-travel_rad, 0.0)
    rad_to_mm = (STROKE_MM + SPAN_INSET_MM) / travel_rad
    parameters = SimulatorParameters(closed_rad=closed_rad, open_rad=open_rad, rad_to_mm=rad_to_mm)
    world = World(mount, calibrated=False, parameters=parameters)
    client = world.enabled()
    client.result("calibration.load", template=mount)
    measured = client.result("calibration.zero")
    assert (measured["ok"], measured["outcome"]) == (True, "measured"), measured
    assert measured["travel_rad"] == pytest.approx(travel_rad, rel=0.01)
    assert measured["rad_to_mm"] == pytest.approx(rad_to_mm, rel=0.01)
    scale = measured["travel_rad"] * measured["rad_to_mm"]
    assert scale == pytest.approx(STROKE_MM + SPAN_INSET_MM)
    assert world.state.scale_doubt is None


@pytest.mark.parametrize("is_measured", [False, True])
def test_with_something_between_the_jaws_no_travel_is_measured(is_measured: bool) -> None:
    """Neither after a template, nor after a measurement."""
    world, client = enabled_world()
    client.result("calibration.load", template="normal")
    if is_measured:
        assert client.result("calibration.zero", save=False)["ok"]
        assert client.result("motion.open")["ok"]
    world.gripper.put_object(width_mm=24.0, stiffness_nm_rad=2000.0)
    again = client.result("calibration.zero", save=False)
    assert (again["ok"], again["outcome"]) == (False, "implausible_travel")
