"""Files that are whole at any instant: every crash and every failure, on a simulated disk."""

import errno
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest

from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import FileSystem
from tests.io.disk import Disk, PowerCut

FOLDER = Path("/state")
PATH = FOLDER / "file"
PREVIOUS = FOLDER / "file.previous"
OTHERS = FOLDER / ".other.0123456789abcdef.tmp"
OLDER, OLD, NEW, NEWER = b"older", b"the old", b"new one", b"the newer"


def write_new(disk: Disk) -> None:
    atomic_file.write(PATH, NEW, keep_previous=PREVIOUS, file_system=disk)


def bare_disk() -> Disk:
    return Disk()


def empty_disk() -> Disk:
    disk = bare_disk()
    disk.put_directory(FOLDER)
    return disk


def disk_with_file() -> Disk:
    disk = empty_disk()
    disk.put(PATH, OLD)
    return disk


def disk_with_both() -> Disk:
    disk = disk_with_file()
    disk.put(PREVIOUS, OLDER)
    return disk


def disk_after_a_crash() -> Disk:
    """Both names mean one file, and there are temporary ones."""
    disk = disk_with_file()
    disk.put_link(PATH, PREVIOUS)
    disk.put(FOLDER / ".file.00000000000000aa.tmp", b"half of")
    disk.put_link(PATH, FOLDER / ".file.previous.00000000000000bb.tmp")
    disk.put(OTHERS, b"of another file")
    return disk


DISKS = [bare_disk, empty_disk, disk_with_file, disk_with_both, disk_after_a_crash]


def wrong(after: Disk, before: dict[Path, bytes], finished: bool) -> str | None:
    """Say what is wrong with a disk that was found after a crash while NEW was written."""
    found = after.files()
    content = found.get(PATH)
    if finished and content != NEW:
        return "it was not durable"
    if content is None and PATH in before:
        return "it was lost"
    if content not in (before.get(PATH), NEW):
        return "it was damaged"
    previous = found.get(PREVIOUS)
    if content == NEW and PATH in before and previous != before[PATH]:
        return "the previous one was lost"
    if previous not in (before.get(PREVIOUS), before.get(PATH)):
        return "the previous one was damaged"
    return None


def crashes(
    make: Callable[[], Disk], write: Callable[[Disk], None]
) -> Iterator[tuple[Disk, str | None]]:
    """Cut the power before each call of `write`, and after it; yield what may be found then."""
    before = make().files()
    for cut_at in count():
        disk = make()
        disk.cut_at = cut_at
        try:
            write(disk)
        except PowerCut:
            finished = False
        else:
            finished = True
        for after in disk.after_power_cut():
            yield after, wrong(after, before, finished)
        if finished:
            return


@pytest.mark.parametrize("make", DISKS)
def test_a_power_cut_at_any_instant_leaves_the_old_file_or_the_new_one(
    make: Callable[[], Disk],
) -> None:
    found = list(crashes(make, write_new))
    assert {problem for _, problem in found} == {None}
    assert len(found) > 20
    contents = {after.files().get(PATH) for after, _ in found}
    assert contents == {make().files().get(PATH), NEW}


@pytest.mark.parametrize("make", DISKS)
def test_a_process_that_is_killed_at_any_instant_leaves_one_of_them_too(
    make: Callable[[], Disk],
) -> None:
    before = make().files()
    for cut_at in count():
        disk = make()
        disk.cut_at = cut_at
        try:
            write_new(disk)
        except PowerCut:
            assert wrong(disk, before, finished=False) is None
        else:
            assert wrong(disk, before, finished=True) is None
            return


@pytest.mark.parametrize("make", DISKS)
def test_whatever_a_crash_left_the_next_write_succeeds_and_cleans_up(
    make: Callable[[], Disk],
) -> None:
    left = {after.key(): after for after, _ in crashes(make, write_new)}
    assert len(left) > 3
    for disk in left.values():
        before = disk.files()
        kept = atomic_file.write(PATH, NEWER, keep_previous=PREVIOUS, file_system=disk)
        assert kept == (PATH in before)
        expected = {PATH: NEWER}
        if PATH in before or PREVIOUS in before:
            expected[PREVIOUS] = before.get(PATH, before.get(PREVIOUS, b""))
        if OTHERS in before:
            expected[OTHERS] = before[OTHERS]
        assert disk.files() == expected


def test_a_second_crash_while_the_first_is_mended_does_no_harm_either() -> None:
    left = {after.key(): after for after, _ in crashes(disk_with_both, write_new)}
    for disk in left.values():
        if disk.files()[PATH] == OLD:
            found = {problem for _, problem in crashes(disk.copy, write_new)}
            assert found == {None}


def without_sync(disk: Disk) -> None:
    """A rename without a sync of the file before it."""
    descriptor = disk.create(FOLDER / "t")
    for start in range(0, len(NEW), disk.most_bytes):
        disk.write(descriptor, memoryview(NEW)[start:])
    disk.replace(FOLDER / "t", PATH)
    disk.sync_directory(FOLDER)


def with_removal(disk: Disk) -> None:
    """The old file goes before the new one comes."""
    atomic_file.write(FOLDER / "t", NEW, file_system=disk)
    disk.remove(PATH)
    disk.replace(FOLDER / "t", PATH)
    disk.sync_directory(FOLDER)


def without_directory_sync(disk: Disk) -> None:
    """Nothing waits for the new name."""
    atomic_file.write(FOLDER / "t", NEW, file_system=disk)
    disk.replace(FOLDER / "t", PATH)


def with_previous_unsynced(disk: Disk) -> None:
    """The name of the previous file is made durable together with the new file's."""
    atomic_file.write(FOLDER / "t", NEW, file_system=disk)
    disk.link(PATH, FOLDER / "u")
    disk.replace(FOLDER / "u", PREVIOUS)
    disk.replace(FOLDER / "t", PATH)
    disk.sync_directory(FOLDER)


@pytest.mark.parametrize(
    ("naive", "problem"),
    [
        (without_sync, "it was damaged"),
        (with_removal, "it was lost"),
        (without_directory_sync, "it was not durable"),
        (with_previous_unsynced, "the previous one was lost"),
    ],
)
def test_the_simulated_disk_finds_fault_with_what_is_known_to_be_wrong(
    naive: Callable[[Disk], None], problem: str
) -> None:
    assert problem in {found for _, found in crashes(disk_with_file, naive)}


def test_the_simulated_disk_leaves_no_call_to_the_real_one() -> None:
    calls = {name for name in vars(FileSystem) if not name.startswith("_")}
    assert calls <= set(vars(Disk))


@pytest.mark.parametrize("failure", [errno.ENOSPC, errno.EIO, errno.EACCES, errno.EROFS])
@pytest.mark.parametrize("make", DISKS)
def test_a_failure_of_any_call_is_told_and_leaves_the_old_file(
    make: Callable[[], Disk], failure: int
) -> None:
    trial = make()
    write_new(trial)
    before = make().files()
    for number, call in enumerate(trial.calls):
        disk = make()
        disk.fail_at, disk.failure = number, failure
        if call == "remove":  # what cannot be removed is left for the next time
            write_new(disk)
            assert disk.files()[PATH] == NEW
            continue
        with pytest.raises(OSError, match=r"\[Errno") as caught:
            write_new(disk)
        assert caught.value.errno == failure
        last = number == len(trial.calls) - 1
        assert disk.files().get(PATH) == (NEW if last else before.get(PATH))
        fresh = set(disk.files()) - set(before)
        assert fresh <= {PATH, PREVIOUS}, f"{call} left a temporary file"


def test_a_disk_that_takes_nothing_more_without_an_error_is_one() -> None:
    disk = disk_with_file()
    disk.most_bytes = 0
    with pytest.raises(OSError, match="nothing more can be written"):
        write_new(disk)
    assert disk.files() == {PATH: OLD}
