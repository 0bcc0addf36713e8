"""The owners of the named trajectories, and how many of them a user may have.

`NAME.uid` beside `NAME.lgt` holds the uid of the user who saved it last, as decimal digits. A
trajectory without such a file is old, or was copied there by hand. It has no owner and counts for
no user, and clients cannot make more of them.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import REAL, FileSystem
from litegripd.trajectories.content import ENDING as LGT_ENDING
from litegripd.trajectories.content import StoreError
from litegripd.trajectories.grip_files import path_beside as grips_beside
from litegripd.trajectories.values import name_problem

ENDING = ".uid"

MB = 1_000_000
_LONGEST = 12  # bytes; the largest uid has ten digits
_MAX_UID = 2**32 - 2


@dataclass(frozen=True, slots=True)
class Limits:
    """The most named trajectories, and the most bytes of them together, for one user."""

    most: int = 500
    most_bytes: int = 500 * MB

    @classmethod
    def of(cls, arguments: Sequence[str]) -> "Limits":
        """Return the limits that `arguments` has written; without any, the defaults."""
        return cls(*map(int, arguments))

    def arguments(self) -> tuple[str, str]:
        """Return the limits as arguments of a process."""
        return str(self.most), str(self.most_bytes)


class Owners:
    """The owners of the trajectories in a directory.

    The files themselves are counted. So two daemons of one directory that save at the same instant
    may together exceed a limit by one trajectory; the next one is rejected.
    """

    def __init__(self, limits: Limits, file_system: FileSystem = REAL) -> None:
        self._limits = limits
        self._file_system = file_system

    def usage(self, directory: Path, uid: int) -> dict[str, int]:
        """Return what a user has in `directory`, and may have; raises `OSError`."""
        sizes = [_size_of(path) for path in self._paths_of(directory, uid)]
        return {
            "uid": uid,
            "named": len(sizes),
            "bytes": sum(sizes),
            "most_named": self._limits.most,
            "most_bytes": self._limits.most_bytes,
        }

    def check(self, path: Path, uid: int, size: int) -> None:
        """Raise `StoreError` if `size` bytes more at `path` would exceed a limit of the user.

        A replacement of the user's own file that is no larger is never rejected. Raises `OSError`.
        """
        usage = self.usage(path.parent, uid)
        before = _size_of(path) if self.owner_of(path) == uid and os.path.lexists(path) else None
        if before is None and usage["named"] >= self._limits.most:
            text = (
                f"uid {uid} has {usage['named']} named trajectories, of {self._limits.most} that"
                f" [trajectories] most_per_user allows{_REMEDY}"
            )
            raise StoreError("trajectories_full", text, _data(usage, size))
        growth = size - (before or 0)
        if growth > 0 and usage["bytes"] + growth > self._limits.most_bytes:
            text = (
                f"this trajectory has {size} bytes, and the {usage['named']} that uid {uid} has"
                f" under names have {usage['bytes']}, of {self._limits.most_bytes} that"
                f" [trajectories] most_mb_per_user allows{_REMEDY}"
            )
            raise StoreError("trajectories_full", text, _data(usage, size))

    def owner_of(self, path: Path) -> int | None:
        """Return the uid of a trajectory's owner, or None."""
        return self._owner_in(str(path_beside(path)))

    @staticmethod
    def _owner_in(beside: str) -> int | None:
        """Return the uid in a file beside a trajectory; one answer may read thousands of them."""
        try:
            # A link could lead anywhere; and opening a pipe must not wait for its other end.
            descriptor = os.open(beside, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                text = os.read(descriptor, _LONGEST + 1).strip()
            finally:
                os.close(descriptor)
        except OSError:
            return None
        if len(text) > _LONGEST or not text.isdigit():
            return None
        uid = int(text)
        return uid if uid <= _MAX_UID else None

    @contextlib.contextmanager
    def owned(self, path: Path, uid: int) -> Iterator[None]:
        """Make `uid` the owner of what the block writes at `path`; if it fails, restore the owner.

        The owner is written first, so no new file is ever without one. Raises `OSError`.
        """
        before = self.owner_of(path)
        if before != uid:
            self._save(path, uid)
        try:
            yield
        except OSError:
            with contextlib.suppress(OSError):  # if that fails, `uid` stays the owner
                if before is None:
                    self.forget(path)
                elif before != uid:
                    self._save(path, before)
            raise

    def forget(self, path: Path) -> None:
        """Remove the file with a trajectory's owner, if it exists; raises `OSError`."""
        beside = path_beside(path)
        if os.path.lexists(beside):
            self._file_system.remove(beside)
            self._file_system.sync_directory(beside.parent)

    def _save(self, path: Path, uid: int) -> None:
        content = f"{uid}\n".encode()
        atomic_file.write(path_beside(path), content, file_system=self._file_system)

    def _paths_of(self, directory: Path, uid: int) -> list[Path]:
        names = lgt_names(directory, self._file_system)
        owned = (name for name in names if self._owner_in(f"{directory}/{name}{ENDING}") == uid)
        return [directory / f"{name}{LGT_ENDING}" for name in owned]


def lgt_names(directory: Path, file_system: FileSystem) -> list[str]:
    """Return the names of the trajectories in a directory, sorted; raises `OSError`."""
    try:
        found = file_system.names(directory)
    except FileNotFoundError:
        return []
    names = (name.removesuffix(LGT_ENDING) for name in found if name.endswith(LGT_ENDING))
    return sorted(name for name in names if name_problem(name) is None)


def path_beside(path: Path) -> Path:
    """Return the path of the file with the owner of a trajectory's file."""
    return path.with_name(path.name.removesuffix(LGT_ENDING) + ENDING)


_REMEDY = (
    " in the daemon's configuration: make room (trajectory.delete), or have an administrator raise"
    " it and restart the daemon"
)


def _data(usage: Mapping[str, int], size: int) -> dict[str, Any]:
    return {"usage": dict(usage), "requested": size}


def _size_of(path: Path) -> int:
    """Return the bytes of a trajectory's file and its grips; 0 for a missing file."""
    size = 0
    for one in (path, grips_beside(path)):
        with contextlib.suppress(FileNotFoundError):
            size += one.lstat().st_size
    return size
