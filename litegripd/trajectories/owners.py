"""Whose the named trajectories are, and how many and how much of them a user may have.

`NAME.uid` beside `NAME.lgt` holds the uid of the user who saved it last, as decimal digits. What
has no such file, because it is from before or was copied there by hand, is nobody's and counts for
nobody: no user is refused for what others left, and clients cannot make more of it.
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
    """So many named trajectories, and so many bytes of them together, may a user have."""

    most: int = 500
    most_bytes: int = 500 * MB

    @classmethod
    def of(cls, arguments: Sequence[str]) -> "Limits":
        """Read what `arguments` has made; without any, the defaults."""
        return cls(*map(int, arguments))

    def arguments(self) -> tuple[str, str]:
        """Return them as a process takes them."""
        return str(self.most), str(self.most_bytes)


class Owners:
    """The owners of the trajectories in a directory.

    What is counted is what is there: two daemons of one directory that save at the same instant
    may together be one trajectory above a limit, and the next one is refused.
    """

    def __init__(self, limits: Limits, file_system: FileSystem = REAL) -> None:
        self._limits = limits
        self._file_system = file_system

    def usage(self, directory: Path, uid: int) -> dict[str, int]:
        """Return what a user has of `directory`, and may have; raises `OSError`."""
        sizes = [_size_of(path) for path in self._paths_of(directory, uid)]
        return {
            "uid": uid,
            "named": len(sizes),
            "bytes": sum(sizes),
            "most_named": self._limits.most,
            "most_bytes": self._limits.most_bytes,
        }

    def check(self, path: Path, uid: int, size: int) -> None:
        """Raise `StoreError` where `size` bytes more at `path` would be beyond a limit of the user.

        What replaces one of the same user's and is no larger is never refused. Raises `OSError`.
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
        """Return the uid of a trajectory's owner, None where it is nobody's."""
        return self._owner_in(str(path_beside(path)))

    @staticmethod
    def _owner_in(beside: str) -> int | None:
        """Read a file that says whose something is; thousands may be read for one answer."""
        try:
            # No link, which could lead anywhere; and no waiting for a pipe's other end.
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
        """Make `uid` the owner of what the block writes at `path`; as before where that fails.

        First the owner: at no instant is there anything new that is nobody's. Raises `OSError`.
        """
        before = self.owner_of(path)
        if before != uid:
            self._save(path, uid)
        try:
            yield
        except OSError:
            with contextlib.suppress(OSError):  # then it counts for who meant to replace it
                if before is None:
                    self.forget(path)
                elif before != uid:
                    self._save(path, before)
            raise

    def forget(self, path: Path) -> None:
        """Remove what says whose a trajectory is, if anything does; raises `OSError`."""
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
    """Return the names of the trajectories in a directory, in order; raises `OSError`."""
    try:
        found = file_system.names(directory)
    except FileNotFoundError:
        return []
    names = (name.removesuffix(LGT_ENDING) for name in found if name.endswith(LGT_ENDING))
    return sorted(name for name in names if name_problem(name) is None)


def path_beside(path: Path) -> Path:
    """Return where the owner of a trajectory's file is kept."""
    return path.with_name(path.name.removesuffix(LGT_ENDING) + ENDING)


_REMEDY = (
    " in the daemon's configuration: make room (trajectory.delete), or have an administrator raise"
    " it and restart the daemon"
)


def _data(usage: Mapping[str, int], size: int) -> dict[str, Any]:
    return {"usage": dict(usage), "requested": size}


def _size_of(path: Path) -> int:
    """Return the bytes of a trajectory's file and its grips; 0 for what is not there."""
    size = 0
    for one in (path, grips_beside(path)):
        with contextlib.suppress(FileNotFoundError):
            size += one.lstat().st_size
    return size
