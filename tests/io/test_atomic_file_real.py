"""Files that are whole at any instant, on the real file system: names, modes, what is refused."""

import os
import stat
from pathlib import Path

import pytest

from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import REAL, FileError
from tests.io.disk import ordinary_user

OLD, NEW = b"the old", b"new one"


def names(directory: Path) -> list[str]:
    return sorted(entry.name for entry in directory.iterdir())


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_real_file_is_written_with_its_directory(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "file"
    umask = os.umask(0o022)
    try:
        assert not atomic_file.write(path, NEW, keep_previous=path.with_name("before"))
    finally:
        os.umask(umask)
    assert path.read_bytes() == NEW
    assert [mode(path), mode(path.parent), mode(path.parent.parent)] == [0o644, 0o755, 0o755]
    assert names(path.parent) == ["file"]


def test_the_real_file_before_is_kept_under_its_other_name(tmp_path: Path) -> None:
    path, previous = tmp_path / "file", tmp_path / "before"
    for number in range(4):
        kept = atomic_file.write(path, b"%d" % number, keep_previous=previous)
        assert kept == (number > 0)
    assert (path.read_bytes(), previous.read_bytes()) == (b"3", b"2")
    assert names(tmp_path) == ["before", "file"]


def test_without_a_name_for_it_the_file_before_goes(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for content in (OLD, NEW, b""):
        assert not atomic_file.write(path, content)
        assert path.read_bytes() == content
    assert names(tmp_path) == ["file"]


def test_only_what_calls_for_this_file_left_behind_is_removed(tmp_path: Path) -> None:
    ours = [".file.00112233445566ff.tmp", ".before.00112233445566ff.tmp"]
    others = [".file.tmp", ".fileX00112233445566ff.tmp", ".file2.00112233445566ff.tmp", "x.tmp"]
    for name in ours + others:
        (tmp_path / name).write_bytes(b"")
    path = tmp_path / "file"
    path.write_bytes(OLD)
    atomic_file.write(path, NEW, keep_previous=tmp_path / "before")
    assert names(tmp_path) == sorted([*others, "before", "file"])


def test_the_previous_file_belongs_into_the_same_directory(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must be in"):
        atomic_file.write(tmp_path / "file", NEW, keep_previous=tmp_path / "a" / "file")
    assert names(tmp_path) == []


@pytest.mark.parametrize("taken", ["file", "before"])
def test_a_directory_in_place_of_a_file_is_an_error(tmp_path: Path, taken: str) -> None:
    (tmp_path / "file").write_bytes(OLD)
    if taken == "file":
        (tmp_path / "file").unlink()
    (tmp_path / taken).mkdir()
    before = names(tmp_path)
    with pytest.raises(IsADirectoryError):
        atomic_file.write(tmp_path / "file", NEW, keep_previous=tmp_path / "before")
    assert names(tmp_path) == before
    assert taken == "file" or (tmp_path / "file").read_bytes() == OLD


def test_a_file_in_place_of_the_directory_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "state").write_bytes(b"")
    with pytest.raises(NotADirectoryError):
        atomic_file.write(tmp_path / "state" / "file", NEW)


def test_a_read_only_directory_is_an_error() -> None:
    with ordinary_user() as folder:
        path = folder / "file"
        path.write_bytes(OLD)
        folder.chmod(0o555)
        with pytest.raises(PermissionError):
            atomic_file.write(path, NEW, keep_previous=folder / "before")
        assert names(folder) == ["file"]
        assert path.read_bytes() == OLD


def test_the_real_file_system_refuses_a_name_that_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(OLD)
    with pytest.raises(FileExistsError):
        REAL.create(path)
    with pytest.raises(FileExistsError):
        REAL.link(path, path)


def test_a_text_is_read_within_its_bounds(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("grün", encoding="utf-8")
    assert atomic_file.read(path, 5) == "grün"
    with pytest.raises(FileError, match=f"{path}: larger than 4 bytes"):
        atomic_file.read(path, 4)


def test_what_is_no_text_is_an_error_that_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"\xff")
    with pytest.raises(FileError, match=f"{path}: byte 0xFF in line 1 is not UTF-8"):
        atomic_file.read(path, 10)
    with pytest.raises(FileError, match=f"{tmp_path}: cannot be read: Is a directory"):
        atomic_file.read(tmp_path, 10)
    for absent in (tmp_path / "no", path / "no"):
        with pytest.raises(FileNotFoundError):
            atomic_file.read(absent, 10)


def test_the_real_disk_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file, then its old name, then its new one: no test can cut this machine's power."""
    synced: list[Path] = []

    def fsync(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        real_fsync(descriptor)

    real_fsync = os.fsync
    monkeypatch.setattr(os, "fsync", fsync)
    path = tmp_path / "state" / "file"
    atomic_file.write(path, OLD, keep_previous=path.with_name("before"))
    atomic_file.write(path, NEW, keep_previous=path.with_name("before"))
    folder = path.parent
    directories = [entry for entry in synced if entry.suffix != ".tmp"]
    assert directories == [tmp_path, folder, folder, folder]
    assert [synced.index(entry) for entry in synced if entry.suffix == ".tmp"] == [1, 3]
