"""Where trajectories lie on the client's side."""

import os
import threading
from pathlib import Path

import pytest

from litegrip_client import CommandError, Trajectory, TrajectorySample, list_trajectories
from litegrip_client.values.trajectory import path_of
from tests.trajectories import lgt


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "trajectories"
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    return path


def trajectory(count: int = 3) -> Trajectory:
    samples = [TrajectorySample(n / 100, 0.5, 0.0, 0.0, 0.0) for n in range(count)]
    return Trajectory(samples, 100.0, 1.7e9, 0.114, -1.491, 74.8, mount="reverse")


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def test_names_and_paths(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LITEGRIP_TRAJ_DIR", raising=False)
    usual = home / ".litegrip" / "trajectories"
    assert path_of("pick") == path_of("pick.lgt") == path_of(Path("pick")) == usual / "pick.lgt"
    assert path_of("pick.v2") == usual / "pick.v2.lgt"
    assert path_of(f"{tmp_path}/x") == tmp_path / "x"
    assert path_of("~/x.lgt") == home / "x.lgt"
    monkeypatch.chdir(tmp_path)
    assert path_of("./x") == tmp_path / "x"
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", "~/mine")
    assert path_of("pick") == home / "mine" / "pick.lgt"
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", "")
    assert path_of("pick") == usual / "pick.lgt"


@pytest.mark.parametrize("name", ["", ".", "..", ".hidden", "a\0b", None, 7, b"pick"])
def test_what_cannot_be_a_name(folder: Path, name: object) -> None:
    for use in (trajectory().save, Trajectory.load):
        with pytest.raises(CommandError, match="cannot be a trajectory's name") as caught:
            use(name)  # type: ignore[arg-type]
        assert caught.value.reason == "invalid_params"
    assert not folder.exists()


def test_saving_replaces_what_is_there_and_leaves_nothing_else(folder: Path) -> None:
    trajectory(1).save("pick")
    path = trajectory(2).save("pick")
    assert path == str(folder / "pick.lgt")
    assert Trajectory.load("pick") == trajectory(2)
    assert names_in(folder) == ["pick.lgt"]


def test_saving_by_a_link_writes_where_it_points(folder: Path, tmp_path: Path) -> None:
    folder.mkdir()
    target = tmp_path / "target.lgt"
    (folder / "pick.lgt").symlink_to(target)
    trajectory().save("pick")
    assert (folder / "pick.lgt").is_symlink()
    assert target.exists()
    assert Trajectory.load("pick") == trajectory()


def test_what_is_there_stays_whole_when_saving_fails(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory(1).save("pick")

    def full(_file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CommandError, match="No space left on device") as caught:
        trajectory(2).save("pick")
    assert caught.value.reason == "not_saved"
    assert Trajectory.load("pick") == trajectory(1)
    assert names_in(folder) == ["pick.lgt"]


def test_threads_that_save_at_once_leave_one_whole_file(folder: Path) -> None:
    threads = [threading.Thread(target=trajectory(n).save, args=("pick",)) for n in range(1, 9)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20.0)
    assert len(Trajectory.load("pick")) in range(1, 9)
    assert names_in(folder) == ["pick.lgt"]


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
def test_a_directory_that_cannot_be_written_is_named(folder: Path) -> None:
    folder.mkdir(mode=0o500)
    with pytest.raises(CommandError, match="Permission denied"):
        trajectory().save("pick")


def test_what_is_no_directory_cannot_be_written_to(folder: Path) -> None:
    folder.write_text("in the way")
    with pytest.raises(CommandError, match="cannot be written") as caught:
        trajectory().save("pick")
    assert caught.value.reason == "not_saved"
    with pytest.raises(CommandError, match="cannot be read: Not a directory"):
        list_trajectories()


def test_what_cannot_be_loaded_is_named_with_the_reason(folder: Path) -> None:
    folder.mkdir()
    with pytest.raises(CommandError, match=r"there is no trajectory .*/pick\.lgt") as caught:
        Trajectory.load("pick")
    assert isinstance(caught.value, FileNotFoundError)
    assert caught.value.reason == "unknown_trajectory"
    assert caught.value.__suppress_context__, "one traceback is enough"
    trajectory().save("pick")
    with pytest.raises(CommandError, match=r"there is no trajectory .*; did you mean 'pick'\?"):
        Trajectory.load("pikc")
    (folder / "bad.lgt").write_bytes(lgt([(0.0, 2.0)]))
    with pytest.raises(CommandError, match=r"bad\.lgt: sample 0: openness is 2\.0"):
        Trajectory.load("bad")
    (folder / "folder.lgt").mkdir()
    os.mkfifo(folder / "pipe.lgt")
    for name in ("folder", "pipe"):
        with pytest.raises(CommandError, match=f"{name}.lgt cannot be read: it is no regular file"):
            Trajectory.load(name)
    with (folder / "long.lgt").open("wb") as file:
        file.truncate(10**9)  # without a single block of it on the disk
    with pytest.raises(CommandError, match="larger than 360000 samples"):
        Trajectory.load("long")


def test_the_list_tells_of_each_file_what_its_header_says(folder: Path) -> None:
    assert list_trajectories() == []
    trajectory(101).save("b")
    trajectory(0).save("a")
    (folder / "c.lgt").write_bytes(trajectory(2).to_bytes()[:-1])
    (folder / "d.lgt").write_bytes(lgt([], sample_hz=0.0))
    (folder / "e.lgt").write_bytes(lgt([(2.5, 0.5), (2.75, 0.5)]))
    (folder / "note.txt").write_text("no trajectory")
    (folder / ".b.lgt.1.2.new").write_bytes(b"")
    a, b, c, d, e = list_trajectories()
    assert [str(a), str(b)] == [
        "a: 0.00 s, 0 samples, mount reverse",
        "b: 1.00 s, 101 samples, mount reverse",
    ]
    assert (b.path, b.sample_hz, b.created) == (str(folder / "b.lgt"), 100.0, 1.7e9)
    assert c.error is not None
    assert str(c) == f"c: {c.error}"
    assert "145 bytes, but 2 samples make 146" in c.error
    assert d.error == "sample_hz is 0.0, it must be above 0"
    assert e.duration_s == 0.25
