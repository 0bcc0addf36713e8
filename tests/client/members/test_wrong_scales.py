"""Calibrations whose scale or limits are wrong, on every path by which a program brings one."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CalibrationData, CommandError, GripperConfig, LiteGrip, ParameterError
from litegripd.model.gripper import STROKE_RANGE_MM
from tests.app.test_calibrations_that_cannot_be import NORMAL, SCALES, WRONG, figures
from tests.drop_in import Daemon, Site
from tests.geometry import STROKE_MM

Brings = Callable[[LiteGrip, dict[str, Any], Path, pytest.MonkeyPatch], object]


def written(path: Path, content: dict[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def by_values(gripper: LiteGrip, content: dict[str, Any], *_: Any) -> object:
    return gripper.use_calibration(CalibrationData.from_content(content))


def by_path(gripper: LiteGrip, content: dict[str, Any], home: Path, _: Any) -> object:
    return gripper.load_calibration(written(home / "mine.json", content))


def by_variable(
    gripper: LiteGrip, content: dict[str, Any], home: Path, patch: pytest.MonkeyPatch
) -> object:
    patch.setenv("LITEGRIP_CALIB", str(written(home / "pinned.json", content)))
    return gripper.load_calibration()


def by_own_file(gripper: LiteGrip, content: dict[str, Any], home: Path, _: Any) -> object:
    written(home / ".litegrip" / "can0_calibration.json", content)
    return gripper.load_calibration()


BRINGS: list[Brings] = [by_values, by_path, by_variable, by_own_file]


@pytest.mark.parametrize("bring", BRINGS, ids=lambda one: one.__name__)
@pytest.mark.parametrize("content", WRONG)
def test_what_a_program_brings_is_refused_and_the_one_in_use_stays(
    daemon: Daemon,
    gripper: LiteGrip,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    bring: Brings,
    content: dict[str, Any],
) -> None:
    before, in_use = gripper.config, daemon.controller.calibrated.calibration
    with pytest.raises(CommandError) as caught:
        bring(gripper, content, home, monkeypatch)
    assert caught.value.reason == "calibration_unreadable"
    for words in figures(content):
        assert words in str(caught.value)
    assert gripper.config == before
    assert daemon.controller.calibrated.calibration is in_use
    assert gripper.open()


@pytest.mark.parametrize("factor", SCALES)
@pytest.mark.parametrize("method", ["zero", "calibrate", "calibrate_guided", "rescale_calibration"])
@pytest.mark.parametrize("own", ["assigned", "given"])
def test_a_stroke_of_a_programs_own_config_is_refused_before_anything_moves(
    site: Site, daemon: Daemon, gripper: LiteGrip, own: str, method: str, factor: float
) -> None:
    stroke_mm = factor * STROKE_MM
    if own == "given":
        gripper.disconnect()
        gripper = LiteGrip("can0", config=GripperConfig(max_stroke_mm=stroke_mm))
        gripper.connect()
        gripper.enable()
    else:
        gripper.config.max_stroke_mm = stroke_mm
    before_rad, before = daemon.gripper.position_rad, daemon.controller.calibrated.calibration
    is_one = stroke_mm <= STROKE_RANGE_MM[1]
    says = "the configured stroke is 85 mm" if is_one else "it must be 1 to 1000"
    with pytest.raises(ParameterError, match=says):
        getattr(gripper, method)()
    site.run(0.5)
    assert daemon.gripper.position_rad == pytest.approx(before_rad, abs=1e-3)
    assert daemon.controller.calibrated.calibration is before


@pytest.mark.parametrize("factor", SCALES)
def test_a_program_that_expects_another_scale_is_told(
    daemon: Daemon, gripper: LiteGrip, factor: float
) -> None:
    """The limits and the scale of a program's config are compared, never used."""
    expected = GripperConfig(rad_to_mm=factor * NORMAL.rad_to_mm)
    before = daemon.controller.calibrated.calibration
    with pytest.raises(CommandError, match="rad_to_mm"):
        LiteGrip("can0", config=expected).connect()
    assert daemon.controller.calibrated.calibration is before
