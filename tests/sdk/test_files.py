"""Calibration files: which one counts, what it sets, and what is written."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest

import litegrip
from litegrip import LiteGrip

FIGURES: dict[str, Any] = {
    "zero_position_rad": 0.05,
    "max_position_rad": -1.36,
    "rad_to_mm": 61.0,
}


@pytest.fixture(autouse=True)
def _at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    monkeypatch.setattr(
        litegrip.gripper, "DEFAULT_CALIB", str(home / ".litegrip/litegrip_calibration.json")
    )


def write(path: Path, **more: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(FIGURES | more), encoding="utf-8")
    return path


def own(home: Path, channel: str = "can0") -> Path:
    return home / ".litegrip" / f"{channel}_calibration.json"


def test_a_file_sets_what_it_has(home: Path) -> None:
    path = write(own(home), can_id=9, mst_id=25, kp=5.0, work_stroke_mm=70.0, channel="can0")
    gripper = LiteGrip()
    assert gripper.load_calibration() is True
    config = gripper.config
    assert (config.pos_closed_rad, config.pos_open_rad, config.rad_to_mm) == (0.05, -1.36, 61.0)
    assert (config.kp, config.kd, config.work_stroke_mm, config.max_stroke_mm) == (
        5.0,
        2.0,
        70.0,
        85.0,
    )
    assert (gripper.can_id, gripper.mst_id, gripper.mount) == (9, 25, "normal")
    write(path, calibrated=False, can_id=0)
    gripper.load_calibration()
    assert (config.calibrated, gripper.mount, gripper.can_id) == (False, None, 9)


def test_the_order_is_own_older_factory(home: Path, caplog: pytest.LogCaptureFixture) -> None:
    gripper = LiteGrip()
    assert gripper.load_calibration()
    assert gripper.config.rad_to_mm == 52.69  # the factory's
    write(home / ".litegrip/litegrip_calibration.json", rad_to_mm=62.0)
    gripper.load_calibration()
    assert gripper.config.rad_to_mm == 62.0
    with caplog.at_level(logging.INFO, "litegrip"):
        write(own(home), channel="can1")
        gripper.load_calibration()
    assert gripper.config.rad_to_mm == 62.0
    assert "can1" in caplog.text
    write(own(home))
    gripper.load_calibration()
    assert gripper.config.rad_to_mm == 61.0


def test_nothing_for_another_channel_is_false(caplog: pytest.LogCaptureFixture) -> None:
    gripper = LiteGrip("can5")
    before = litegrip.GripperConfig(can_channel="can5")
    assert gripper.load_calibration() is False
    assert gripper.config == before
    assert "no calibration" in caplog.text


def test_a_path_that_is_missing_or_no_json_is_the_factorys(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broken = tmp_path / "broken.json"
    broken.write_text("{", encoding="utf-8")
    for path in (tmp_path / "none.json", broken):
        gripper = LiteGrip()
        caplog.clear()
        assert gripper.load_calibration(str(path)) is True
        assert gripper.config.rad_to_mm == 52.69
        assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_a_path_of_another_channel_is_loaded_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    gripper = LiteGrip()
    assert gripper.load_calibration(str(write(tmp_path / "one.json", channel="can7")))
    assert "can7" in caplog.text
    assert gripper.channel == "can7"


def test_what_cannot_be_loaded(tmp_path: Path) -> None:
    gripper = LiteGrip()
    with pytest.raises(litegrip.CommandError, match="normal, reverse"):
        gripper.load_template("upside down")
    with pytest.raises(litegrip.CommandError, match="normal"):
        LiteGrip(mount="upside down")
    with pytest.raises(litegrip.CommandError, match="one of them"):
        gripper.load_calibration("x", template="normal")
    path = tmp_path / "one.json"
    path.write_text('{"zero_position_rad": 1.0}', encoding="utf-8")
    with pytest.raises(KeyError):
        gripper.load_calibration(str(path))
    for wrong in (float("nan"), float("inf"), 0.0, "61", True):
        write(path, rad_to_mm=wrong)
        with pytest.raises(litegrip.CommandError):
            gripper.load_calibration(str(path))
    for key in ("kp", "kd", "grasp_torque_threshold", "work_stroke_mm", "can_id", "mst_id"):
        write(path, **{key: "0x08"})
        with pytest.raises(litegrip.CommandError, match=key):
            gripper.load_calibration(str(path))
    assert gripper.config == litegrip.GripperConfig()


def test_templates_have_the_geometry_alone() -> None:
    gripper = LiteGrip(mount="reverse")
    assert gripper.mount == "reverse"
    assert (gripper.config.kp, gripper.config.work_stroke_mm) == (100.0, 80.0)
    for path in litegrip.CALIB_TEMPLATES.values():
        assert LiteGrip().load_calibration(path)


def test_saving_keeps_keys_of_others(home: Path, tmp_path: Path) -> None:
    gripper = LiteGrip(mount="normal")
    write(own(home), lab="west")
    assert gripper.save_calibration() == str(own(home))
    saved = json.loads(own(home).read_text())
    assert list(saved)[-1] != ""
    assert saved["lab"] == "west"
    assert (saved["channel"], saved["calibrated"], saved["canfd_mode"]) == ("can0", True, False)
    assert saved["travel_range_rad"] == pytest.approx(1.651026)
    assert "mst_id" not in saved
    assert "max_stroke_mm" not in saved
    target = tmp_path / "deep" / "one.json"
    assert gripper.save_calibration(str(target)) == str(target)
    assert LiteGrip().load_calibration(str(target))
    with pytest.raises(litegrip.CommandError, match="not to be written"):
        gripper.save_calibration(litegrip.CALIB_TEMPLATES["normal"])


def test_the_environment_names_one_for_all_channels(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(home / "one.json")
    monkeypatch.setenv("LITEGRIP_CALIB", str(path))
    gripper = LiteGrip("can4")
    assert gripper.load_calibration()
    assert gripper.config.rad_to_mm == 61.0
    assert gripper.save_calibration() == str(path)
