"""The SDK's section "Reverse mounts and two grippers on one machine": channels and their files."""

import json
from pathlib import Path

import pytest

from litegrip_client import CommandError, LiteGrip
from tests.drop_in import Daemon, Site, a_site
from tests.geometry import CLOSED_RAD, MM_RAD, TRAVEL_MM
from tests.sdk.conftest import MOUNTS
from tests.sdk.readme.motions import MOTIONS
from tests.sdk.readme.scenes import bench_unit, content, own_file, write_file


def test_the_channel_is_the_only_key_of_two_grippers_with_the_same_can_id(site: Site) -> None:
    left = site.add(Daemon("can0", "normal"))
    right = site.add(Daemon("can1", "reverse"))
    with LiteGrip("can0") as first, LiteGrip("can1") as second:
        assert (first.config.can_id, second.config.can_id) == (0x08, 0x08)
        assert (first.mount, second.mount) == ("normal", "reverse")
        first.enable()
        first.close()
        assert left.gripper.opening_mm == pytest.approx(0.0, abs=1.0)
        assert right.gripper.opening_mm == pytest.approx(60.0, abs=0.1)
        assert not right.is_energised
        second.enable()
        second.open()
        assert left.gripper.opening_mm == pytest.approx(0.0, abs=1.0)
        assert right.gripper.opening_mm == pytest.approx(TRAVEL_MM, abs=1.0)


def test_calibrations_are_stored_one_file_per_channel(site: Site) -> None:
    """By the daemons, in their own directory; the SDK's ~/.litegrip is still read."""
    units = {"can0": bench_unit("normal"), "can1": bench_unit("reverse")}
    files, measured = {}, {}
    for (channel, unit), mount in zip(units.items(), MOUNTS, strict=True):
        site.add(Daemon(channel, mount, calibrated=False, parameters=unit))
        with LiteGrip(channel, mount=mount) as gripper:
            gripper.enable()
            measured[channel] = gripper.zero()
            files[channel] = Path(gripper.save_calibration())
    assert files["can0"] != files["can1"]
    for channel, file in files.items():
        assert file.name == f"{channel}_calibration.json"
        saved = json.loads(file.read_text(encoding="utf-8"))
        assert saved["channel"] == channel
        assert saved["zero_position_rad"] == measured[channel].zero_position_rad
        assert saved["max_position_rad"] == measured[channel].max_position_rad


def test_load_calibration_reads_the_own_file_then_the_legacy_one_then_the_factory_one(
    site: Site, home: Path
) -> None:
    """It reads ~/.litegrip, where the SDK keeps them, and saves in the daemon's own directory."""
    site.add(Daemon(calibrated=False))
    own = own_file(home, "can0", "reverse", rad_to_mm=53.0)
    legacy = home / ".litegrip" / "litegrip_calibration.json"
    write_file(legacy, "reverse", rad_to_mm=54.0)
    found = []
    with LiteGrip("can0") as gripper:
        for gone in (own, legacy, None):
            assert gripper.load_calibration()
            config = gripper.config
            found.append((config.rad_to_mm, config.close_sign, config.pos_closed_rad))
            saved = Path(gripper.save_calibration())
            assert saved == home / "state" / "can0_calibration.json"
            assert json.loads(saved.read_text(encoding="utf-8"))["channel"] == "can0"
            if gone is not None:
                gone.unlink()
            saved.unlink()
    reverse_rad = content("reverse")["zero_position_rad"]
    assert found == [(53.0, -1, reverse_rad), (54.0, -1, reverse_rad), (MM_RAD, 1, CLOSED_RAD)]


def test_a_users_own_file_wins_over_the_factory_one_whoever_runs_the_daemon(
    site: Site, home: Path
) -> None:
    """The factory's is a normal mount, and this gripper is none."""
    own_file(home, "can0", "reverse")
    daemon = site.add(Daemon(mount="reverse", boots=True, home=home / "of_the_daemon"))
    with LiteGrip("can0") as gripper:
        assert gripper.mount == "normal"  # what the daemon found by itself
        assert gripper.load_calibration()
        assert gripper.mount == "reverse"
        gripper.enable()
        assert gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("named", ["the legacy file", "the own file"])
def test_a_candidate_for_another_channel_is_skipped_and_the_motions_fail_loudly(
    site: Site, home: Path, named: str
) -> None:
    name = "litegrip" if named == "the legacy file" else "can1"
    write_file(home / ".litegrip" / f"{name}_calibration.json", "normal", channel="can0")
    daemon = site.add(Daemon("can1", "reverse", calibrated=False))
    with LiteGrip("can1") as gripper:
        assert gripper.load_calibration() is False
        assert gripper.mount is None
        gripper.enable()
        for motion in MOTIONS.values():
            with pytest.raises(CommandError):
                motion(gripper)
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)


def test_litegrip_calib_pins_one_file_for_every_channel(home: Path) -> None:
    pinned = write_file(home / "pinned.json", "reverse", channel="can7", rad_to_mm=73.0)
    own_file(home, "can0", "normal")
    with a_site(home, {"LITEGRIP_CALIB": str(pinned)}) as site:
        for channel in ("can1", "can0"):
            site.add(Daemon(channel, "reverse", calibrated=False))
            with LiteGrip(channel) as gripper:
                assert gripper.load_calibration()
                assert (gripper.mount, gripper.config.rad_to_mm) == ("reverse", 73.0)
                gripper.enable()
                data = gripper.zero()
                assert Path(gripper.save_calibration()) == pinned
            saved = json.loads(pinned.read_text(encoding="utf-8"))
            assert saved["zero_position_rad"] == data.zero_position_rad
            write_file(pinned, "reverse", channel="can7", rad_to_mm=73.0)
