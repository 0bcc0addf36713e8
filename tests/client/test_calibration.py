from typing import Any

import pytest

from litegrip_client import (
    CalibrationData,
    CommandError,
    GripperConfig,
    HardwareError,
    LiteGrip,
    ProtocolError,
    UnitConversion,
)
from tests.client.fake_daemon import CONTENT, HELLO, RAD_TO_MM, ZERO, FakeDaemon
from tests.geometry import SPAN_MM, STROKE_MM, WORK_MM


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


def test_the_gripper_as_the_daemon_drives_it(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["info.get"] = lambda request: {**HELLO, "registers": {}}
    config = gripper.config
    assert (config.pos_closed_rad, config.pos_open_rad) == (0.104334, -1.513123)
    assert (config.rad_to_mm, config.kp, config.kd) == (RAD_TO_MM, 100.0, 2.0)
    assert (config.close_sign, config.calibrated) == (1, True)
    assert (config.channel, config.can_id, config.mst_id) == ("can0", 8, 24)
    assert config.travel_mm == pytest.approx(SPAN_MM)
    assert (config.max_stroke_mm, config.work_stroke_mm) == (STROKE_MM, WORK_MM)
    with pytest.raises(CommandError, match=r"config\.kp cannot be set"):
        config.kp = 150.0


def test_a_gripper_without_a_calibration() -> None:
    gone = {"calibrated": False, "closed_rad": None, "open_rad": None, "rad_to_mm": None}
    gripper = {**HELLO["gripper"], **gone}  # type: ignore[dict-item]
    config = GripperConfig.from_wire({**HELLO, "gripper": gripper})
    assert (config.calibrated, config.close_sign, config.travel_mm) == (False, None, None)


def test_a_reverse_mount_closes_by_decreasing_radians() -> None:
    turned = {"closed_rad": -1.5, "open_rad": 0.1}
    gripper = {**HELLO["gripper"], **turned}  # type: ignore[dict-item]
    assert GripperConfig.from_wire({**HELLO, "gripper": gripper}).close_sign == -1


def test_units() -> None:
    assert UnitConversion.N_TO_NM == 0.1
    assert UnitConversion.n_to_nm(20.0) == pytest.approx(2.0)
    assert UnitConversion.nm_to_n(2.0) == pytest.approx(20.0)
    assert UnitConversion.mm_to_rad(74.19, 74.19) == pytest.approx(1.0)
    assert UnitConversion.rad_to_mm(0.5, 74.0) == pytest.approx(37.0)
