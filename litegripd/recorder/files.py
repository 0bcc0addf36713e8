"""The flight recorder's dumps on the disk, written by the helper process.

A bounded amount is kept. Dumps that a client asked for are counted apart from the others: no
request may remove the record of a fault. A number in the name gives the order. The time of day in
the name is for people: the clock may have been set since.
"""

import contextlib
import re
import time
from pathlib import Path

from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import FileError
from litegripd.io.helper.child import MEMORY_FD
from litegripd.io.helper.files import own_directory
from litegripd.io.shared_memory import copy_of
from litegripd.model.calibration import Dumped
from litegripd.recorder.mcap import to_mcap
from litegripd.recorder.reader import read

KEPT_FILES = 10
KEPT_BYTES = 64_000_000
"""For each sort: asked for by a client, or written by the daemon itself."""

_ASKED_FOR = "demand"
_NAME = re.compile(r"\.?(\d+)-\d{8}T.+\.mcap")
"""The name of a dump, or of one that is being written; files with other names are left alone."""


def dump(cause: str, note: str, memory_fd: int = MEMORY_FD) -> Dumped:
    """Write the recorder's content to a new file; return its path and a summary.

    Raises `FileError` if it cannot be written, or if nothing is recorded yet.
    """
    now_ns, monotonic_ns = time.time_ns(), time.monotonic_ns()
    recording = read(copy_of(memory_fd))
    if not recording.ticks:
        raise FileError("nothing has been recorded yet")
    content = to_mcap(recording, cause, note, now_ns - monotonic_ns)
    directory = own_directory(str(recording.about["channel"]), "dumps")
    newest = max((number for number, _path in _numbered(directory, "*.mcap")), default=0)
    path = directory / _name(newest + 1, cause, now_ns)
    try:
        atomic_file.write(path, content)
        prune(path.parent, keep=path)
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror}") from error
    return {
        "path": str(path),
        "ticks": len(recording.ticks),
        "seconds": round(recording.duration_s, 3),
        "bytes": len(content),
    }


def prune(directory: Path, keep: Path) -> None:
    """Remove the oldest dumps of the sort of `keep` beyond `KEPT_BYTES`, but never `keep`."""
    asked_for = _is_asked_for(keep)
    dumps = [
        path for _n, path in _numbered(directory, "*.mcap") if _is_asked_for(path) == asked_for
    ]
    total_bytes = 0
    for place, path in enumerate(dumps):
        total_bytes += path.stat().st_size
        if path != keep and (place >= KEPT_FILES or total_bytes > KEPT_BYTES):
            path.unlink()
    for number, path in _numbered(directory, ".*.mcap.*.tmp"):  # of killed helpers
        # During a restart another helper may write at the same time.
        if abs(number - _number(keep)) > 1:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()


def _numbered(directory: Path, pattern: str) -> list[tuple[int, Path]]:
    """Return the dumps that match `pattern`, with their numbers, the newest first."""
    ours = (path for path in directory.glob(pattern) if _NAME.match(path.name))
    return sorted(((_number(path), path) for path in ours), reverse=True)


def _number(path: Path) -> int:
    return int(path.name.lstrip(".").partition("-")[0])


def _is_asked_for(path: Path) -> bool:
    return path.stem.endswith(f"-{_ASKED_FOR}")


def _name(number: int, cause: str, now_ns: int) -> str:
    """Return a name with the rising `number`, by which names sort, and the time of day, UTC."""
    seconds, rest_ns = divmod(now_ns, 1_000_000_000)
    stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime(seconds))
    return f"{number:06}-{stamp}.{rest_ns // 1_000_000:03}Z-{cause}.mcap"
