"""Small files that are complete at any instant: a crash leaves the old content or the new one.

The content goes to a temporary file beside the target, which is renamed over it once it is on the
disk. Nothing here knows what the files mean, and nothing here may run in the control thread.
"""

import contextlib
import errno
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from litegrip_client.values.text import text_of

_FILE_MODE = 0o644
_DIRECTORY_MODE = 0o755
_TOKEN_BYTES = 8


class FileError(ValueError):
    """A file that cannot be used or written; the message names it and says why."""


class FileSystem:
    """The operating system's calls that writing a file needs; each raises `OSError`.

    Overridden as a whole where another file system is to take the place of the real one.
    """

    def is_directory(self, path: Path) -> bool:
        """Return True if there is a directory."""
        return path.is_dir()

    def make_directory(self, path: Path) -> None:
        """Make a directory in one that exists."""
        path.mkdir(_DIRECTORY_MODE)

    def names(self, directory: Path) -> list[str]:
        """Return the names in a directory."""
        return [entry.name for entry in directory.iterdir()]

    def create(self, path: Path) -> int:
        """Create a file that must not exist; return a descriptor to write it."""
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, _FILE_MODE)

    def write(self, descriptor: int, content: memoryview) -> int:
        """Write the beginning of `content`; return how many bytes."""
        return os.write(descriptor, content)

    def sync(self, descriptor: int) -> None:
        """Wait until a file's content is on the disk; its name may still be lost."""
        os.fsync(descriptor)

    def close(self, descriptor: int) -> None:
        """Close a descriptor."""
        os.close(descriptor)

    def link(self, existing: Path, new: Path) -> None:
        """Give a file a second name that must not exist."""
        os.link(existing, new, follow_symlinks=False)

    def replace(self, source: Path, target: Path) -> None:
        """Rename `source` to `target`, in place of what is there.

        Does nothing at all where both already name one file, as POSIX wants it.
        """
        source.replace(target)

    def remove(self, path: Path) -> None:
        """Remove a name."""
        path.unlink()

    def sync_directory(self, directory: Path) -> None:
        """Wait until the names in a directory are on the disk."""
        descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


REAL = FileSystem()


def write(
    path: Path,
    content: bytes,
    *,
    keep_previous: Path | None = None,
    file_system: FileSystem = REAL,
) -> bool:
    """Write a file; a crash at any instant leaves the complete old one or the complete new one.

    Makes the directory where it is missing (mode 0755; the file has 0644; both less the umask).
    The file that was there stays as `keep_previous`, a name in the same directory; the result
    tells whether there was one. What a crash of an earlier call left behind is removed.

    Raises `OSError` where that fails. The old file is then still there, except when only the
    last step failed, waiting for the new name to be on the disk: then it is one of the two.
    Raises `ValueError` for a `keep_previous` in another directory.
    """
    directory = path.parent
    if keep_previous is not None and keep_previous.parent != directory:
        raise ValueError(f"{keep_previous} must be in {directory}, like the file it is kept of")
    if file_system.is_directory(path):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    _make_directory(directory, file_system)
    _remove_leftovers(path, file_system)
    with _temporary(path, file_system) as new:
        _write_whole(new, content, file_system)
        kept = keep_previous is not None and _keep(path, keep_previous, file_system)
        file_system.replace(new, path)
    file_system.sync_directory(directory)
    return kept


def read(path: Path, most_bytes: int) -> str:
    """Return the text of a UTF-8 file of at most `most_bytes`.

    Raises `FileNotFoundError` where there is none, `FileError` for one that cannot be used.
    """
    try:
        # No waiting for another end, where there is a FIFO instead of a file.
        with open(path, "rb", opener=_open_at_once) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise FileError(f"{path}: not a regular file")
            content = file.read(most_bytes + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from None
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > most_bytes:
        raise FileError(f"{path}: larger than {most_bytes} bytes")
    try:
        return text_of(content)
    except ValueError as error:
        raise FileError(f"{path}: {error}") from error


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


def _write_whole(path: Path, content: bytes, file_system: FileSystem) -> None:
    descriptor = file_system.create(path)
    try:
        left = memoryview(content)
        while left:
            written = file_system.write(descriptor, left)
            if written == 0:  # no error, no progress: never wait for it in a circle
                raise OSError(errno.EIO, "nothing more can be written", str(path))
            left = left[written:]
        file_system.sync(descriptor)
    finally:
        file_system.close(descriptor)


def _keep(path: Path, previous: Path, file_system: FileSystem) -> bool:
    """Let `previous` name the present file, too; False where there is none.

    It is on the disk before `path` is replaced, so that no crash can lose the old content.
    """
    _remove_leftovers(previous, file_system)
    with _temporary(previous, file_system) as second_name:
        try:
            file_system.link(path, second_name)
        except FileNotFoundError:
            return False
        file_system.replace(second_name, previous)
    file_system.sync_directory(path.parent)
    return True


def _make_directory(directory: Path, file_system: FileSystem) -> None:
    """Make a directory and those above it that are missing, and their names durable."""
    if file_system.is_directory(directory):
        return
    _make_directory(directory.parent, file_system)
    with contextlib.suppress(FileExistsError):  # another process may have been faster
        file_system.make_directory(directory)
    file_system.sync_directory(directory.parent)


@contextmanager
def _temporary(path: Path, file_system: FileSystem) -> Iterator[Path]:
    """Yield a free name beside `path`; a file of that name is removed in the end."""
    name = path.with_name(f".{path.name}.{secrets.token_hex(_TOKEN_BYTES)}.tmp")
    try:
        yield name
    finally:
        # Mostly it has been renamed. What cannot be removed now, the next call removes.
        with contextlib.suppress(OSError):
            file_system.remove(name)


def _remove_leftovers(path: Path, file_system: FileSystem) -> None:
    """Remove the temporary files that calls for `path` left when they were killed."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{{2 * _TOKEN_BYTES}}}\.tmp")
    for name in file_system.names(path.parent):
        if ours.fullmatch(name):
            # One that cannot be removed is no obstacle: each call takes a name of its own.
            with contextlib.suppress(OSError):
                file_system.remove(path.parent / name)
