"""The SDK's section "Reverse mounts and two grippers on one machine"."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from litegrip_client import (
    CALIB_TEMPLATES,
    CalibrationData,
    CommandError,
    LiteGrip,
    list_templates,
)
from tests.drop_in import Daemon, Site
from tests.geometry import MM_RAD, SPAN_MM, TRAVEL_MM
from tests.sdk.conftest import MOUNTS
from tests.sdk.readme.motions import MOTIONS
from tests.sdk.readme.scenes import bench_unit, content, write_file

SELECTIONS: dict[str, Callable[[LiteGrip, str], object]] = {
    "constructor": lambda gripper, mount: LiteGrip("can0", mount=mount).connect(),
    "load_template": lambda gripper, mount: gripper.load_template(mount),
    "load_calibration by name": lambda gripper, mount: gripper.load_calibration(template=mount),
    "load_calibration by path": lambda gripper, mount: gripper.load_calibration(
        CALIB_TEMPLATES[mount]
    ),
}


def test_the_direction_follows_from_the_order_of_the_limits(site: Site, mount: str) -> None:
    """Closing means increasing radians on a normal mount, and decreasing on a reverse one."""
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        assert gripper.load_calibration(write_file(Path.home() / "any.json", mount))
        config, sign = gripper.config, 1 if mount == "normal" else -1
        assert config.pos_open_rad is not None
        assert config.pos_closed_rad is not None
        assert (config.pos_open_rad >= config.pos_closed_rad) is (mount == "reverse")
        assert (config.close_sign, gripper.mount) == (sign, mount)
        gripper.enable()
        assert gripper.open()
        open_rad = daemon.gripper.position_rad
        assert daemon.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=1.0)
        assert gripper.close()
        assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)
        assert (daemon.gripper.position_rad - open_rad) * sign > 1.0


@pytest.mark.parametrize("motion", MOTIONS)
def test_until_a_calibration_is_loaded_motions_raise(site: Site, mount: str, motion: str) -> None:
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        gripper.enable()
        assert gripper.mount is None
        with pytest.raises(CommandError) as caught:
            MOTIONS[motion](gripper)
        site.run(0.5)
    assert caught.value.reason == "not_calibrated"
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)


def test_the_templates_have_names_in_order() -> None:
    assert list_templates() == ["normal", "reverse"]


def test_zero_measures_the_real_travel_and_saves_it(site: Site, home: Path, mount: str) -> None:
    """The template was nominal: it said the direction, not the travel of this gripper."""
    unit = bench_unit(mount)
    daemon = site.add(Daemon("can1", mount, calibrated=False, parameters=unit))
    with LiteGrip("can1", mount=mount) as gripper:
        nominal = gripper.config
        gripper.enable()
        with site.recorded(daemon) as moments:
            data = gripper.zero()
        after = gripper.config
        assert gripper.mount == mount
        file = home / "state" / "can1_calibration.json"
        saved = json.loads(file.read_text(encoding="utf-8"))
        assert Path(gripper.save_calibration()) == file
    assert (nominal.pos_closed_rad, nominal.rad_to_mm) == (
        content(mount)["zero_position_rad"],
        MM_RAD,
    )
    openings = [moment.opening_mm for moment in moments]
    assert max(openings) == pytest.approx(SPAN_MM, abs=1.0)
    assert -3.0 < min(openings) < 1.0  # the press that confirms the stop gives the soft end a way
    assert isinstance(data, CalibrationData)
    assert data.zero_position_rad == pytest.approx(unit.closed_rad, abs=0.01)
    assert data.max_position_rad == pytest.approx(unit.open_rad, abs=0.01)
    assert data.travel_range_rad == pytest.approx(abs(unit.closed_rad - unit.open_rad), abs=0.01)
    assert data.rad_to_mm == pytest.approx(SPAN_MM / data.travel_range_rad)
    assert after.close_sign == nominal.close_sign
    assert after.rad_to_mm == pytest.approx(unit.rad_to_mm, rel=0.01)
    assert after.travel_mm == pytest.approx(SPAN_MM)
    for key in ("zero_position_rad", "max_position_rad", "rad_to_mm", "travel_range_rad"):
        assert saved[key] == getattr(data, key)
    restarted = site.add(Daemon("can1", mount, boots=True, gripper=daemon.gripper))
    with LiteGrip("can1") as gripper:
        assert gripper.config.pos_closed_rad == data.zero_position_rad
        gripper.enable()
        assert gripper.close()
        assert restarted.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("selection", SELECTIONS)
def test_the_same_selection_is_reachable_four_ways(site: Site, mount: str, selection: str) -> None:
    other = "reverse" if mount == "normal" else "normal"
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        gripper.load_template(other)
        SELECTIONS[selection](gripper, mount)
        expected = json.loads(Path(CALIB_TEMPLATES[mount]).read_text(encoding="utf-8"))
        loaded = gripper.config
        assert loaded.pos_closed_rad == expected["zero_position_rad"]
        assert loaded.pos_open_rad == expected["max_position_rad"]
        assert loaded.rad_to_mm == expected["rad_to_mm"]
        assert gripper.mount == mount
        gripper.enable()
        assert gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("name", ["sideways", "Reverse", "", "../factory"])
def test_a_name_outside_the_list_raises_and_lists_the_valid_ones(site: Site, name: str) -> None:
    site.add(Daemon(calibrated=False))
    with LiteGrip("can0") as gripper:
        for choose in (
            lambda: LiteGrip("can0", mount=name),
            lambda: gripper.load_template(name),
            lambda: gripper.load_calibration(template=name),
        ):
            with pytest.raises(CommandError, match="normal, reverse"):
                choose()
        assert gripper.mount is None


@pytest.mark.parametrize("damage", ["missing", "not JSON"])
def test_a_template_that_cannot_be_read_raises_instead_of_falling_back(
    site: Site, home: Path, damage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = home / "templates"
    broken.mkdir()
    write_file(broken / "factory.json", "normal", channel="can0")
    if damage != "missing":
        (broken / "reverse.json").write_text("{", encoding="utf-8")
    monkeypatch.setattr("litegripd.io.helper.files.DATA", broken)
    site.add(Daemon(mount="reverse", calibrated=False))
    with LiteGrip("can0") as gripper:
        for choose in (
            LiteGrip("can0", mount="reverse").connect,
            lambda: gripper.load_template("reverse"),
            lambda: gripper.load_calibration(template="reverse"),
            lambda: gripper.load_calibration(CALIB_TEMPLATES["reverse"]),
        ):
            with pytest.raises(CommandError, match=r"reverse\.json"):
                choose()
        assert gripper.mount is None
        gripper.enable()
        with pytest.raises(CommandError):
            gripper.close()


def test_a_small_move_shows_which_way_the_jaws_travel(site: Site, mount: str) -> None:
    for template in MOUNTS:
        daemon = site.add(Daemon(mount=mount, calibrated=False))
        with LiteGrip("can0", mount=template) as gripper:
            gripper.enable()
            before_mm = daemon.gripper.opening_mm
            opening_mm = gripper.get_state().opening_mm
            assert opening_mm is not None
            assert gripper.goto(opening_mm - 10.0)
            closed_by_mm = before_mm - daemon.gripper.opening_mm
        assert closed_by_mm == pytest.approx(10.0 if template == mount else -10.0, abs=1.5)


def test_the_wrong_mount_is_logged_on_load_and_the_first_close_heads_the_wrong_way(
    site: Site, mount: str
) -> None:
    other = "reverse" if mount == "normal" else "normal"
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    daemon.service.take_events()
    with LiteGrip("can0", mount=other) as gripper:
        turning = {"normal": "increasing", "reverse": "decreasing"}[other]
        logged = " ".join(event.message for event in daemon.service.take_events())
        assert f"mount {other}, closing by {turning} radians" in logged
        gripper.enable()
        gripper.close()
        assert daemon.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=1.0)
