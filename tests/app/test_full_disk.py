"""A full disk is named to who acts and in health, and forgotten once there is space again."""

import errno
import logging
import os
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.ctl.files import put_file
from litegrip_client.values import atomic_file, calibration_files, trajectory
from litegrip_client.values.errors import CommandError
from litegripd.app import helper_main, status
from litegripd.app.build import LOOK_AT_DISKS_EVERY_S, DiskWatch
from litegripd.io.helper.atomic_file import FileError, FileSystem
from litegripd.io.helper.files import save_motion
from litegripd.model.state import TaskResult
from tests.app.test_facts import parts_of
from tests.world import World

RUNTIME = Path("/run/litegripd")


class Disk:
    """What statvfs says: of all file systems, or of those that begin with a path."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.below = "/"
        self.free_bytes = 10**12
        self.free_files = 1000
        self.files = 1000
        self.is_read_only = False
        self._real = os.statvfs
        monkeypatch.setattr(os, "statvfs", self._ask)

    def _ask(self, path: Any) -> os.statvfs_result:
        is_it = str(path).startswith(self.below)
        blocks = (self.free_bytes if is_it else 10**12) // 512
        files = self.free_files if is_it else 1000
        flags = os.ST_RDONLY if self.is_read_only else 0
        reserved = blocks + 99  # for root alone
        return os.statvfs_result(
            (4096, 512, 10**12, reserved, blocks, self.files, files, files, flags, 255)
        )


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


@pytest.fixture
def state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    return tmp_path


class Full(FileSystem):
    def write(self, descriptor: int, content: memoryview) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_who_has_something_kept_gets_the_place_and_what_is_free(disk: Disk, state: Path) -> None:
    parameters = {"channel": "can0", "config": {}}
    save_motion(parameters)
    path = state / "can0_motion.json"
    before = path.read_bytes()
    disk.free_bytes = 0
    with pytest.raises(FileError) as caught:
        save_motion(parameters, Full())
    assert str(caught.value) == (
        f"{path}: cannot be written: No space left on device on {state}: 0 bytes free, free some"
    )
    assert path.read_bytes() == before
    assert [one.name for one in state.iterdir()] == [path.name]


def test_clients_name_it_too(disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_file: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    disk.free_files = 0
    told = f"on {tmp_path}: 1000000000000 bytes free, no more files"
    for act in (
        lambda: calibration_files.write(tmp_path / "c.json", {"a": 1}),
        lambda: trajectory.write_file(str(tmp_path / "pick.lgt"), b"x"),
        lambda: put_file(str(tmp_path / "out.mcap"), b"x"),
    ):
        with pytest.raises(CommandError, match=told):
            act()
    assert list(tmp_path.iterdir()) == []


def test_another_cause_is_told_as_before() -> None:
    error = PermissionError(errno.EACCES, "Permission denied")
    assert atomic_file.why_not_written(error, "/x/y") == "Permission denied"


@pytest.mark.parametrize(("free_bytes", "free_files", "says"), [
    (0, 5, "No space left on /: 0 bytes free, free some"),
    (65_024, 5, "No space left on /: 65024 bytes free, free some"),
    (10**9, 0, "No space left on /: 1000000000 bytes free, no more files (inodes), free some"),
    (999_936, 5, "Little space left on /: 999936 bytes free, free some"),
    (1_000_448, 5, None),
])  # fmt: skip
def test_full_nearly_full_and_enough(
    disk: Disk, free_bytes: int, free_files: int, says: str | None
) -> None:
    disk.free_bytes, disk.free_files = free_bytes, free_files
    found = atomic_file.shortage("/nothere9/deeper", 1_000_000)
    assert (None if found is None else found.text) == says
    assert found is None or found.is_full == found.text.startswith("No")


def test_file_systems_that_count_no_files_and_those_only_read_are_not_full(disk: Disk) -> None:
    disk.files = disk.free_files = 0
    assert atomic_file.shortage("/") is None
    disk.free_bytes, disk.is_read_only = 0, True
    assert atomic_file.shortage("/") is None


def test_where_things_are_kept_a_file_system_that_can_only_be_read_is_told(
    disk: Disk, state: Path
) -> None:
    """As after an error of the disk; an image that is so by design gets a note, and no alarm."""
    disk.is_read_only = True
    text = f"{state} can only be read: nothing can be kept there"
    assert look() == [{"text": text, "is_full": False, "is_read_only": True}]


def look() -> Any:
    return helper_main.OPERATIONS["disk.look"]({"runtime": "/"})


def test_the_helper_looks_at_each_file_system_once(disk: Disk, state: Path) -> None:
    assert look() == []
    disk.free_bytes, disk.below = 0, str(state)
    (found,) = look()
    assert found["text"] == f"No space left on {state}: 0 bytes free, free some"
    assert found["is_full"]
    disk.free_bytes = atomic_file.LARGEST_BYTES - 512
    (found,) = look()
    assert not found["is_full"]
    disk.free_bytes, disk.below = 0, "/"
    named = [one["text"] for one in look()]
    devices = {os.stat(path).st_dev for path in (state, "/", "/tmp", "/var/log")}  # noqa: PTH116
    assert len(named) == len(devices)


def test_health_names_it_until_there_is_space_again(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    watch = DiskWatch(RUNTIME)
    parts = parts_of(World(), disks=watch)

    def looked(now_s: float, found: list[dict[str, object]]) -> list[str]:
        task = watch.step(now_s)
        assert task is not None
        assert (task.operation, task.parameters) == ("disk.look", {"runtime": str(RUNTIME)})
        task.on_result(TaskResult(found))
        return status._process_complaints(parts)

    full = {"text": "No space left on /var: 0 bytes free, free some", "is_full": True}
    little = {"text": "Little space left on /var: 9 bytes free, free some", "is_full": False}
    assert looked(0.0, []) == []
    assert watch.step(LOOK_AT_DISKS_EVERY_S - 0.1) is None
    for number in (1, 2):
        assert looked(number * LOOK_AT_DISKS_EVERY_S, [full]) == [full["text"]]
    assert looked(3 * LOOK_AT_DISKS_EVERY_S, [little]) == []
    assert watch.nearly_full == [little["text"]]
    said = [(one.levelno, one.getMessage()) for one in caplog.records]
    assert said == [
        (logging.WARNING, full["text"]),
        (logging.INFO, "there is space again on what was full"),
    ]
    task = watch.step(4 * LOOK_AT_DISKS_EVERY_S)
    assert task is not None
    task.on_result(TaskResult(None, "the helper process died"))
    assert watch.nearly_full == [little["text"]]
