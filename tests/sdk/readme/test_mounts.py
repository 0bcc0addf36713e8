"""The SDK's section "Reverse mounts and two grippers on one machine"."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from litegrip_client import CALIB_TEMPLATES, CommandError, GripperConfig, LiteGrip, list_templates
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


def test_closing_means_increasing_radians_on_a_normal_mount_and_decreasing_on_a_reverse_one(
    daemon: Daemon, gripper: LiteGrip, mount: str
) -> None:
    gripper.open()
    open_rad, open_mm = daemon.gripper.position_rad, daemon.gripper.opening_mm
    gripper.close()
    assert daemon.gripper.opening_mm < open_mm - 0.83 * TRAVEL_MM
    closing_sign = 1 if daemon.gripper.position_rad > open_rad else -1
    assert closing_sign == (1 if mount == "normal" else -1)
    assert gripper.config.close_sign == closing_sign


def test_the_direction_follows_from_the_order_of_the_limits(site: Site, mount: str) -> None:
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        file = write_file(Path.home() / "any.json", mount)
        gripper.load_calibration(file)
        assert gripper.config.close_sign == (1 if mount == "normal" else -1)
        assert gripper.mount == mount
        gripper.enable()
        assert gripper.close()
        assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)
        assert gripper.open()
        assert daemon.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=1.0)


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


def test_mount_loads_the_named_template_and_is_read_back_from_the_limits(
    site: Site, mount: str
) -> None:
    daemon = site.add(Daemon("can1", mount, calibrated=False))
    with LiteGrip("can1", mount=mount) as gripper:
        assert gripper.mount == mount
        gripper.enable()
        assert gripper.close()
        assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


def test_zero_measures_the_real_travel_and_saves_it(site: Site, mount: str) -> None:
    unit = bench_unit(mount)
    daemon = site.add(Daemon("can1", mount, calibrated=False, parameters=unit))
    with LiteGrip("can1", mount=mount) as gripper:
        nominal = gripper.config
        gripper.enable()
        data = gripper.zero()
        assert gripper.mount == mount
    assert nominal.pos_closed_rad == content(mount)["zero_position_rad"]
    assert data.zero_position_rad == pytest.approx(unit.closed_rad, abs=0.01)
    assert data.max_position_rad == pytest.approx(unit.open_rad, abs=0.01)
    assert data.travel_range_rad == pytest.approx(abs(unit.closed_rad - unit.open_rad), abs=0.01)
    assert data.rad_to_mm == pytest.approx(SPAN_MM / data.travel_range_rad)
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


def test_mount_is_none_until_calibrated(site: Site, mount: str) -> None:
    site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        assert gripper.mount is None
        gripper.load_template(mount)
        assert gripper.mount == mount


def test_the_templates_are_nominal_and_zero_replaces_them(site: Site, mount: str) -> None:
    """They say the direction, not the travel of this gripper."""
    unit = replace(bench_unit(mount), initial_opening_mm=60.0)
    site.add(Daemon(mount=mount, calibrated=False, parameters=unit))
    with LiteGrip("can0", mount=mount) as gripper:
        gripper.enable()
        before: GripperConfig = gripper.config
        gripper.zero()
        after = gripper.config
    assert (before.rad_to_mm, before.close_sign) == (MM_RAD, after.close_sign)
    assert after.rad_to_mm == pytest.approx(unit.rad_to_mm, rel=0.01)
    assert after.travel_mm == pytest.approx(SPAN_MM)
