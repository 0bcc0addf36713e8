from typing import Any

import pytest

from litegrip_client import (
    CalibrationData,
    CommandError,
    GripperConfig,
    HardwareError,
    ProtocolError,
    Trajectory,
    UnitConversion,
)
from litegripd.model.calibration import NOMINAL
from tests.client.fake_daemon import CONTENT, HELLO, RAD_TO_MM, ZERO
from tests.geometry import (
    CLOSED_RAD,
    MM_RAD,
    OPEN_RAD,
    SPAN_MM,
    STROKE_MM,
    TRAVEL_RAD,
    WORK_MM,
)


def test_a_calibration_has_the_keys_of_its_file() -> None:
    data = CalibrationData.from_content(CONTENT)
    for name in CONTENT.keys() - {"note"}:
        assert getattr(data, name) == CONTENT[name]
    assert data.mount == "normal"


def test_a_template_has_only_geometry() -> None:
    content = {"zero_position_rad": -1.5, "max_position_rad": 0.25, "rad_to_mm": 49.1}
    data = CalibrationData.from_content(content)
    assert (data.mount, data.travel_range_rad, data.calibrated) == ("reverse", 1.75, True)
    assert (data.channel, data.can_id, data.kp, data.work_stroke_mm) == (None, None, None, None)


@pytest.mark.parametrize("content", [{}, {"rad_to_mm": 1.0, "max_position_rad": 1.0}, None])
def test_a_calibration_without_geometry_is_a_protocol_error(content: Any) -> None:
    with pytest.raises(ProtocolError):
        CalibrationData.from_content(content)


@pytest.mark.parametrize(
    ("outcome", "kind"),
    [
        ("implausible_travel", HardwareError),
        ("not_found", HardwareError),
        ("not_saved", CommandError),
        ("of_tomorrow", HardwareError),
    ],
)
def test_measuring_that_failed_raises_what_the_daemon_says(
    outcome: str, kind: type[Exception]
) -> None:
    failed = {**ZERO, "ok": False, "outcome": outcome, "message": "the travel is 0.3 rad"}
    with pytest.raises(kind, match=r"the travel is 0\.3 rad") as caught:
        CalibrationData.from_result(failed)
    assert isinstance(caught.value, HardwareError | CommandError)
    assert caught.value.reason == outcome
    assert caught.value.data["content"] == CONTENT


GRIPPER: dict[str, Any] = HELLO["gripper"]  # type: ignore[assignment]
OLDER = {key: GRIPPER[key] for key in GRIPPER.keys() - {"stroke_mm", "nm_to_n", "work_stroke_mm"}}
BARE = {"calibrated": False, "closed_rad": None, "open_rad": None, "rad_to_mm": None}


@pytest.mark.parametrize(
    ("told", "known"),
    [
        (GRIPPER, {"close_sign": 1, "calibrated": True, "rad_to_mm": RAD_TO_MM}),
        (GRIPPER, {"kp": 100.0, "kd": 2.0, "channel": "can0", "can_id": 8, "mst_id": 24}),
        (GRIPPER, {"pos_closed_rad": 0.104334, "pos_open_rad": -1.513123}),
        (GRIPPER, {"travel_mm": pytest.approx(SPAN_MM), "max_stroke_mm": STROKE_MM}),
        ({**GRIPPER, "closed_rad": -1.5, "open_rad": 0.1}, {"close_sign": -1}),
        ({**GRIPPER, **BARE}, {"calibrated": False, "close_sign": None, "travel_mm": None}),
        ({**GRIPPER, "nm_to_n": 16.4}, {"nm_to_n": 16.4, "work_stroke_mm": WORK_MM}),
        ({**OLDER, "nm_to_n": None, "work_stroke_mm": None}, {"nm_to_n": 10.0}),
        (OLDER, {"max_stroke_mm": STROKE_MM, "work_stroke_mm": 0.0, "nm_to_n": 10.0}),
    ],
)
def test_the_gripper_as_the_daemon_drives_it(told: dict[str, Any], known: dict[str, Any]) -> None:
    config = GripperConfig.from_wire({**HELLO, "registers": {}, "gripper": told})
    assert {name: getattr(config, name) for name in known} == known


def test_the_nominal_figures_are_the_templates() -> None:
    nominal = (CLOSED_RAD, OPEN_RAD, MM_RAD)
    assert (NOMINAL[0].closed_rad, NOMINAL[0].open_rad, NOMINAL[0].rad_to_mm) == nominal
    data, taught = CalibrationData(), Trajectory()
    assert (data.zero_position_rad, data.max_position_rad, data.rad_to_mm) == nominal
    assert data.travel_range_rad == pytest.approx(TRAVEL_RAD)
    assert (taught.pos_closed_rad, taught.pos_open_rad, taught.rad_to_mm) == nominal


def test_the_constants_and_units_are_the_vendors() -> None:
    assert pytest.approx(75.438596) == UnitConversion.RAD_TO_MM
    assert pytest.approx(1.0) == UnitConversion.MM_TO_RAD * UnitConversion.RAD_TO_MM
    assert (UnitConversion.N_TO_NM, UnitConversion.NM_TO_N) == (0.1, 10.0)
    assert UnitConversion.n_to_nm(20.0) == pytest.approx(2.0)
    assert UnitConversion.nm_to_n(2.0) == pytest.approx(20.0)
    assert UnitConversion.mm_to_rad(74.19, 74.19) == pytest.approx(1.0)
    assert UnitConversion.rad_to_mm(0.5, 74.0) == pytest.approx(37.0)
    assert GripperConfig().max_stroke_mm == STROKE_MM
    assert CalibrationData(rad_to_mm=SPAN_MM / TRAVEL_RAD).stroke_mm == pytest.approx(STROKE_MM)
