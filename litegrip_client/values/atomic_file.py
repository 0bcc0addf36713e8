"""Write a file completely or not at all; say why it cannot be, and whether there is room for it.

The caller decides its content and handles errors.
"""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


def write(target: Path, content: bytes, *, makes_folder: bool = True) -> None:
    """Replace the file `target`, and create its directory if `makes_folder`; raises `OSError`."""
    new = target.with_name(f".{target.name}.{os.getpid()}.{threading.get_ident()}.new")
    if makes_folder:
        target.parent.mkdir(parents=True, exist_ok=True)
    try:
        with new.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        new.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):  # it may never have been made
            new.unlink()
        raise


FULL_BYTES = 65_536
"""With less free a file system counts as full: the largest file of settings has so much."""

LARGEST_BYTES = 16_000_000
"""With less free a state directory is nearly full: the longest trajectory has 14.5 MB (`MAX_BYTES`,
with its grips), a dump of a minute at 200 Hz is made of 2.2 MB."""

SYSTEM_DIRECTORIES = ("/tmp", "/var/log")  # noqa: S108 - nothing is written there by name
"""Without room in the first systemd starts no daemon (226), in the other the journal is cut."""

_DISK_FULL = (errno.ENOSPC, errno.EDQUOT)


def why_not_written(error: OSError, path: str | os.PathLike[str]) -> str:
    """Return why a file could not be written; of a full disk, where, how full, and the remedy."""
    said = error.strerror or str(error)
    if error.errno not in _DISK_FULL:
        return said
    directory = _existing(Path(path))
    try:
        free = _told(os.statvfs(directory))
    except OSError:
        free = "it is full"
    return f"{said} on {directory}: {free}, free some"


@dataclass(frozen=True, slots=True)
class Shortage:
    """A file system without the room that it needs; `is_full` where nothing can be written."""

    text: str
    is_full: bool
    is_read_only: bool = False


def shortage(directory: str | os.PathLike[str], least_bytes: int = FULL_BYTES) -> Shortage | None:
    """Return what the file system of a directory lacks for who is not root, None for nothing.

    Without an answer, from a directory that is closed for one, nothing is known to be lacking.
    """
    existing = _existing(Path(directory))
    try:
        found = os.statvfs(existing)
    except OSError:
        return None
    if found.f_flag & os.ST_RDONLY:
        if least_bytes <= FULL_BYTES:  # an image of one has no room by its nature
            return None
        text = f"{existing} can only be read: nothing can be kept there"
        return Shortage(text, is_full=False, is_read_only=True)
    free = f"on {existing}: {_told(found)}, free some"
    if _bytes(found) < FULL_BYTES or _has_no_files(found):
        return Shortage(f"No space left {free}", is_full=True)
    if _bytes(found) < least_bytes:
        return Shortage(f"Little space left {free}", is_full=False)
    return None


def shortages(directories: Iterable[tuple[str, int]]) -> list[Shortage]:
    """Return what directories lack, each with the least that it must have, once a file system."""
    found: dict[int, Shortage] = {}
    for directory, least_bytes in directories:
        lacking = shortage(directory, least_bytes)
        if lacking is not None:
            found.setdefault(os.stat(_existing(Path(directory))).st_dev, lacking)  # noqa: PTH116
    return list(found.values())


def _existing(path: Path) -> Path:
    """Return the nearest directory above that exists: `path` itself, if it is one."""
    return next((one for one in (path, *path.parents) if os.path.isdir(one)), Path("/"))  # noqa: PTH112


def _told(found: os.statvfs_result) -> str:
    files = ", no more files (inodes)" if _has_no_files(found) else ""
    return f"{_bytes(found)} bytes free{files}"


def _bytes(found: os.statvfs_result) -> int:
    return found.f_bavail * found.f_frsize


def _has_no_files(found: os.statvfs_result) -> bool:
    """Return True if no file more can be made; some file systems count none at all."""
    return found.f_files > 0 and found.f_favail == 0
