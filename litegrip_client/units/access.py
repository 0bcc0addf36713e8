"""True if the daemons' user can run what is installed: each file and directory that it takes.

Modes are judged, and no command is run: the user may not exist yet, and then it is as all others.
"""

from __future__ import annotations

import importlib.util
import os
import pwd
import stat
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

USER = "litegrip"

_READ, _SEARCH = 4, 1
"""Rights of a mode; the latter is also that to run a program."""
_ACCESS_LIST = "system.posix_acl_access"


@dataclass(frozen=True, slots=True)
class Reader:
    """Who is to read: a user that there is, or one of whom nothing is known."""

    uid: int = -1
    gids: frozenset[int] = frozenset()

    def may(self, path: Path, bits: int) -> bool:
        """Return True if a file's mode lets them; one with its own access list is trusted."""
        found = path.stat()
        shift = 6 if found.st_uid == self.uid else 3 if found.st_gid in self.gids else 0
        return (found.st_mode >> shift) & bits == bits or _has_access_list(path)


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A file or directory that keeps a user from running the daemon, and why."""

    path: Path
    why: str

    def __str__(self) -> str:
        return f"{self.path} {self.why}"


def reader_of(name: str = USER) -> Reader:
    """Return what the system knows of a user."""
    try:
        entry = pwd.getpwnam(name)
    except KeyError:
        return Reader()
    return Reader(entry.pw_uid, frozenset(os.getgrouplist(name, entry.pw_gid)))


def obstacle(programs: str, reader: Reader) -> Obstacle | None:
    """Return the first thing that keeps a user from running the daemon, if any."""
    for path, bits in _needed(Path(programs)):
        for step in _way(path):
            why = _closed(step, reader, bits if step == path else 0)
            if why is not None:
                return Obstacle(step, why)
    return None


def _closed(step: Path, reader: Reader, bits: int) -> str | None:
    """Return why a reader lacks these rights, or None; directories must always let them through."""
    try:
        mode = step.stat().st_mode
        needed = bits | (_SEARCH if stat.S_ISDIR(mode) else 0)
        return None if reader.may(step, needed) else f"is closed to it (mode {mode & 0o7777:04o})"
    except OSError as error:
        return f"cannot be used: {error.strerror}"


def _needed(programs: Path) -> Iterator[tuple[Path, int]]:
    """Yield the programs, their interpreters, its library, and all packages."""
    for name in ("litegripd", "litegripctl"):
        yield programs / name, _READ | _SEARCH
        first = (programs / name).read_bytes().partition(b"\n")[0]
        if first.startswith(b"#!/"):
            yield Path(os.fsdecode(first[2:].split()[0])), _SEARCH
    yield Path(os.__file__), _READ
    for kind in ("purelib", "platlib"):
        packages = Path(sysconfig.get_path(kind))
        yield packages, _READ
        found = (path for path in sorted(packages.iterdir()) if path.name != "__pycache__")
        yield from ((path, _READ) for path in found)
    for name in ("litegripd", "litegrip_client"):  # elsewhere in an editable installation
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            yield Path(spec.origin).parent, _READ


def _way(path: Path) -> list[Path]:
    """List each directory on the way to a file, and the file, links followed one by one."""
    way: dict[Path, None] = {}
    left = [path]
    while left:
        current = left.pop()
        for step in (*reversed(current.parents), current):
            if step not in way:
                way[step] = None
                if step.is_symlink():
                    left.append(step.parent / step.readlink())
    return list(way)


def _has_access_list(path: Path) -> bool:
    try:
        return _ACCESS_LIST in os.listxattr(path)
    except OSError:  # a file system that has none
        return False
