"""The lock on a channel in the run directory, which only those who may run its daemon can write.

A name in the abstract socket namespace can be taken by anybody; a file in there cannot.
"""

import fcntl
import hashlib
import logging
import os
from pathlib import Path

_log = logging.getLogger(__name__)

RUN_DIRECTORY = Path("/run/litegripd")
_MODE = 0o600


class LockedError(RuntimeError):
    """Another process holds the lock."""


class ChannelLock:
    """The lock of one claim, held as long as any process has `descriptor` open."""

    def __init__(self, descriptor: int, path: Path) -> None:
        self.descriptor = descriptor
        self._path = path

    def remove(self) -> None:
        """Remove the file, while it is locked: at the end of a daemon that has no successor."""
        self._path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self.descriptor)


def lock_path(claim: str) -> Path:
    """Return the lock's file for a claim; CAN interfaces belong to a network namespace."""
    namespace = Path("/proc/self/ns/net").stat().st_ino
    digest = hashlib.sha256(f"{namespace}/{claim}".encode()).hexdigest()
    return RUN_DIRECTORY / f"{digest[:32]}.lock"


def lock_channel(claim: str) -> ChannelLock | None:
    """Take the lock of a claim; None where this user may not use the run directory.

    Raises `LockedError` where another process has it.
    """
    path = lock_path(claim)
    while True:
        try:
            path.parent.mkdir(mode=0o755, exist_ok=True)
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
            descriptor = os.open(path, flags, _MODE)
        except OSError as error:
            _log.debug("there is no lock in %s: %s", path.parent, error)
            return None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_ino == path.stat().st_ino:
                return ChannelLock(descriptor, path)
        except BlockingIOError:
            os.close(descriptor)
            raise LockedError from None
        except FileNotFoundError:
            _log.debug("%s was removed by its last owner just now", path)
        os.close(descriptor)
