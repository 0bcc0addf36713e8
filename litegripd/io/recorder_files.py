"""The dumps of the flight recorder on the disk, written by the helper process.

A bounded number is kept, those that somebody asked for apart from the others: nobody's curiosity
may remove the record of a fault.
"""

import contextlib
import time
from pathlib import Path

from litegripd.control.recording import read
from litegripd.io import atomic_file
from litegripd.io.atomic_file import FileError
from litegripd.io.calibration_files import own_directory
from litegripd.io.child import MEMORY_FD
from litegripd.io.recorder_mcap import to_mcap
from litegripd.io.shared_memory import copy_of

KEPT_FILES = 10
KEPT_BYTES = 64_000_000
"""Of each sort: asked for, or written by the daemon itself."""

_ASKED_FOR = "demand"
_LEFT_OVER_AFTER_S = 600.0


def dump(cause: str, note: str, memory_fd: int = MEMORY_FD) -> dict[str, object]:
    """Write what the recorder holds now to a new file; return its path, and what is in it.

    Raises `FileError` where it cannot be written, and where nothing has been recorded yet.
    """
    now_ns = time.time_ns()
    memory = copy_of(memory_fd)
    recording = read(memory)
    if not recording.ticks:
        raise FileError("nothing has been recorded yet")
    content = to_mcap(recording, cause, note, now_ns - time.monotonic_ns())
    path = own_directory(str(recording.about["channel"]), "dumps") / _name(cause, now_ns)
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
    """Remove the oldest dumps of the sort of `keep` beyond what is kept, but never that one."""
    asked_for = _is_asked_for(keep)
    dumps = [path for path in directory.glob("*.mcap") if _is_asked_for(path) == asked_for]
    total_bytes = 0
    for number, path in enumerate(sorted(dumps, reverse=True)):
        total_bytes += path.stat().st_size
        if path != keep and (number >= KEPT_FILES or total_bytes > KEPT_BYTES):
            path.unlink()
    for path in directory.glob(".*.mcap.*.tmp"):  # of a helper that was killed while it wrote
        with contextlib.suppress(FileNotFoundError):  # or that has just ended its work
            if time.time() - path.stat().st_mtime > _LEFT_OVER_AFTER_S:
                path.unlink()


def _is_asked_for(path: Path) -> bool:
    return path.stem.endswith(f"-{_ASKED_FOR}")


def _name(cause: str, now_ns: int) -> str:
    """Return a name that sorts by time, UTC."""
    seconds, rest_ns = divmod(now_ns, 1_000_000_000)
    stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime(seconds))
    return f"{stamp}.{rest_ns // 1_000_000:03}Z-{cause}.mcap"
