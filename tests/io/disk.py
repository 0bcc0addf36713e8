"""Disks for tests. A simulated one knows what a power cut may leave of what was written.

Content is safe once its file was synced, a name once its directory was. Of what was not synced,
any prefix of a file's new content may survive, or zeros in its place, and any subset of the
changes of names, each change whole: a rename is never half done.
"""

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count, product
from pathlib import Path
from typing import TypeAlias

from litegripd.io.helper.atomic_file import FileSystem

Names: TypeAlias = dict[Path, int]
"""Which file (a number, as an inode's) each name means."""


class PowerCut(BaseException):
    """The machine is off: no clean-up can do anything any more."""


class Disk(FileSystem):
    """A file system in memory; writes at most `most_bytes` at a time, so every write is short.

    `cut_at` is the number of the call at which the power goes, `fail_at` that of the call that
    fails with `failure`.
    """

    def __init__(self, most_bytes: int = 3) -> None:
        self.most_bytes = most_bytes
        self.cut_at: int | None = None
        self.fail_at: int | None = None
        self.failure = errno.ENOSPC
        self.calls: list[str] = []
        self.names_now: Names = {}
        self.durable: Names = {}
        self.pending: list[dict[Path, int | None]] = []
        self.content: dict[int, bytes] = {}
        self.synced: dict[int, bytes] = {}
        self.directories: set[int] = set()
        self._numbers = count(1)
        self.put_directory(Path("/"))

    # What tests set up and look at.

    def put_directory(self, path: Path) -> None:
        """Let a directory be there, safely."""
        number = next(self._numbers)
        self.directories.add(number)
        self.names_now[path] = self.durable[path] = number

    def put(self, path: Path, content: bytes) -> None:
        """Let a file be there, safely."""
        number = next(self._numbers)
        self.content[number] = self.synced[number] = content
        self.names_now[path] = self.durable[path] = number

    def put_link(self, existing: Path, new: Path) -> None:
        """Let a second name of a file be there, safely."""
        self.names_now[new] = self.durable[new] = self.names_now[existing]

    def files(self) -> dict[Path, bytes]:
        """Return what a running program sees."""
        found = self.names_now.items()
        return {path: self.content[number] for path, number in found if number in self.content}

    def after_power_cut(self) -> Iterator["Disk"]:
        """Yield every disk that may be found after a power cut now."""
        for survives in product((False, True), repeat=len(self.pending)):
            names = dict(self.durable)
            for change, survived in zip(self.pending, survives, strict=True):
                if survived:
                    _apply(change, names)
            names = {path: number for path, number in names.items() if self._has_way(path, names)}
            files = sorted({number for number in names.values() if number in self.content})
            for contents in product(*(self._remains(number) for number in files)):
                yield self._made_of(names, dict(zip(files, contents, strict=True)))

    def key(self) -> frozenset[tuple[frozenset[Path], bytes]]:
        """Return what tells this disk from another."""
        groups: dict[int, set[Path]] = {}
        for path, number in self.names_now.items():
            groups.setdefault(number, set()).add(path)
        return frozenset(
            (frozenset(paths), self.content.get(number, b"directory"))
            for number, paths in groups.items()
        )

    def copy(self) -> "Disk":
        """Return the same disk again, after power came back."""
        return self._made_of(self.names_now, self.content)

    def _has_way(self, path: Path, names: Names) -> bool:
        return all(names.get(above) in self.directories for above in path.parents)

    def _remains(self, number: int) -> set[bytes]:
        """Return what may be left of a file's content."""
        safe, now = self.synced[number], self.content[number]
        prefixes = {now[:length] for length in range(len(safe), len(now) + 1)}
        return prefixes | {safe + bytes(len(now) - len(safe))}

    def _made_of(self, names: Names, contents: dict[int, bytes]) -> "Disk":
        disk = Disk(self.most_bytes)
        disk.names_now, disk.durable = dict(names), dict(names)
        disk.directories = set(self.directories)
        disk.content, disk.synced = dict(contents), dict(contents)
        disk._numbers = count(max(names.values()) + 1)
        return disk

    # The calls.

    def _call(self, name: str) -> None:
        if self.cut_at is not None and len(self.calls) >= self.cut_at:
            raise PowerCut
        self.calls.append(name)
        if len(self.calls) - 1 == self.fail_at:
            raise OSError(self.failure, os.strerror(self.failure))

    def _change(self, change: dict[Path, int | None]) -> None:
        _apply(change, self.names_now)
        self.pending.append(change)

    def _number(self, path: Path) -> int:
        if path not in self.names_now:
            raise FileNotFoundError(errno.ENOENT, "no such file", str(path))
        return self.names_now[path]

    def _must_be_free(self, path: Path) -> None:
        self._number(path.parent)
        if path in self.names_now:
            raise FileExistsError(errno.EEXIST, "it exists", str(path))

    def is_directory(self, path: Path) -> bool:
        self._call("is_directory")
        return self.names_now.get(path) in self.directories

    def make_directory(self, path: Path) -> None:
        self._call("make_directory")
        self._must_be_free(path)
        number = next(self._numbers)
        self.directories.add(number)
        self._change({path: number})

    def names(self, directory: Path) -> list[str]:
        self._call("names")
        self._number(directory)
        return [path.name for path in self.names_now if path.parent == directory]

    def create(self, path: Path) -> int:
        self._call("create")
        self._must_be_free(path)
        number = next(self._numbers)
        self.content[number] = self.synced[number] = b""
        self._change({path: number})
        return number

    def write(self, descriptor: int, content: memoryview) -> int:
        self._call("write")
        written = bytes(content[: self.most_bytes])
        self.content[descriptor] += written
        return len(written)

    def sync(self, descriptor: int) -> None:
        self._call("sync")
        self.synced[descriptor] = self.content[descriptor]

    def close(self, descriptor: int) -> None:
        self._call("close")

    def link(self, existing: Path, new: Path) -> None:
        self._call("link")
        number = self._number(existing)
        self._must_be_free(new)
        self._change({new: number})

    def replace(self, source: Path, target: Path) -> None:
        self._call("replace")
        number = self._number(source)
        if self.names_now.get(target) != number:  # else it does nothing, says POSIX
            self._change({source: None, target: number})

    def remove(self, path: Path) -> None:
        self._call("remove")
        self._number(path)
        self._change({path: None})

    def sync_directory(self, directory: Path) -> None:
        self._call("sync_directory")
        self._number(directory)
        waiting, self.pending = self.pending, []
        for change in waiting:
            if directory in {path.parent for path in change}:
                _apply(change, self.durable)
            else:
                self.pending.append(change)


def _apply(change: dict[Path, int | None], names: Names) -> None:
    for path, number in change.items():
        if number is None:
            names.pop(path, None)
        else:
            names[path] = number


@contextmanager
def ordinary_user() -> Iterator[Path]:
    """Give up root's right to read and write anything, if held; yield a directory to work in."""
    root = os.geteuid() == 0
    with tempfile.TemporaryDirectory() as name:
        if root:
            os.chown(name, 65534, -1)
            os.seteuid(65534)
        try:
            yield Path(name)
        finally:
            if root:
                os.seteuid(0)
            for directory in (Path(name), *Path(name).glob("*/")):
                directory.chmod(0o755)
