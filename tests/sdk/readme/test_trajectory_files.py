"""The SDK's section "Trajectory record and replay": files, and the command line."""

import struct
from pathlib import Path

import pytest

from litegrip_client import (
    CommandError,
    Trajectory,
    list_trajectories,
)
from litegrip_client.ctl.main import main
from tests.drop_in import Daemon, Site
from tests.sdk.readme.trajectories import pose, swing, teach


def test_the_same_from_the_command_line(
    site: Site, daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    site.run(0.01)
    assert main(["enable"]) == 0
    teach(site, daemon)
    assert main(["record", "pick", "--seconds", "1"]) == 0
    taught_mm = daemon.gripper.opening_mm
    assert main(["close"]) == 0
    capsys.readouterr()
    assert main(["trajectories"]) == 0
    line, usage = capsys.readouterr().out.splitlines()[1:]
    assert line.split()[:4] == ["pick", "100", "0.99", "s"]
    assert "1 of 500" in usage
    assert main(["play", "pick", "--repeat", "3"]) == 0
    assert daemon.gripper.opening_mm == pytest.approx(taught_mm, abs=2.5)
    assert "3 passes" in capsys.readouterr().out


def test_save_writes_where_the_environment_says_and_a_path_as_written(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory = swing()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("LITEGRIP_TRAJ_DIR", raising=False)
    usual = home / ".litegrip" / "trajectories" / "pick.lgt"
    assert trajectory.save("pick") == str(usual)
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path / "mine"))
    assert trajectory.save("pick") == str(tmp_path / "mine" / "pick.lgt")
    written = tmp_path / "elsewhere" / "pick.bin"
    assert trajectory.save(str(written)) == str(written)
    assert usual.read_bytes() == written.read_bytes()


def test_load_reads_it_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path))
    trajectory = swing(torque_nm=0.25)
    trajectory.save("pick")
    assert Trajectory.load("pick") == trajectory
    with pytest.raises(CommandError, match=r"there is no trajectory .*other\.lgt"):
        Trajectory.load("other")


def test_a_listing_has_one_line_per_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No hardware is needed, and no daemon."""
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path))
    assert list_trajectories() == []
    swing().save("wave")
    pose(0.5).save("pose")
    (tmp_path / "broken.lgt").write_bytes(b"LGRTRJ01")
    names = [line.partition(":")[0] for line in map(str, list_trajectories())]
    assert names == ["broken", "pose", "wave"]
    assert str(list_trajectories()[2]) == "wave: 2.00 s, 201 samples"
    assert main(["trajectories", "--local"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1 + 3


def test_the_format_has_a_magic_header_of_8_bytes(tmp_path: Path) -> None:
    path = Path(swing().save(str(tmp_path / "a.lgt")))
    whole = path.read_bytes()
    assert whole[:8] == b"LGRTRJ01"
    assert len(whole) == 66 + 201 * 40
    path.write_bytes(b"LGRTRJ02" + whole[8:])
    with pytest.raises(CommandError, match=r"no \.lgt file"):
        Trajectory.load(str(path))


@pytest.mark.parametrize("off", [-40, -1, 1, 40])
def test_a_length_that_does_not_match_the_sample_count_is_rejected(
    tmp_path: Path, off: int
) -> None:
    path = Path(swing().save(str(tmp_path / "a.lgt")))
    whole = path.read_bytes()
    path.write_bytes(whole[:off] if off < 0 else whole + bytes(off))
    with pytest.raises(CommandError, match="201 samples make 8106"):
        Trajectory.load(str(path))
    path.write_bytes(whole[:10] + struct.pack("<I", 200) + whole[14:])
    with pytest.raises(CommandError, match="200 samples make 8066"):
        Trajectory.load(str(path))
