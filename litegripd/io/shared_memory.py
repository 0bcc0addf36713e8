"""Memory of fixed size that the control process writes and its helper reads.

Either may die first. It belongs to no file system: it is gone when the last process that has it is
gone.
"""

import fcntl
import mmap
import os

_LEAST_FD = 64  # above the descriptors that a child finds at fixed numbers


class SharedMemory:
    """Memory of a fixed size, all zero; `fd` is given to a child, `view` is written.

    All of it is allocated at the start: no later write can fail for want of memory. Raises
    `OSError` if there is not enough.
    """

    def __init__(self, size_bytes: int) -> None:
        low_fd = os.memfd_create("litegripd-recorder")
        try:
            os.posix_fallocate(low_fd, 0, size_bytes)
            self.fd = fcntl.fcntl(low_fd, fcntl.F_DUPFD_CLOEXEC, _LEAST_FD)
        finally:
            os.close(low_fd)
        self._map = mmap.mmap(self.fd, size_bytes, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        self.view = memoryview(self._map)

    def close(self) -> None:
        """Close the descriptor; the mapping stays while anybody has a part of it."""
        os.close(self.fd)


def copy_of(fd: int) -> bytes:
    """Return the memory's present content; raises `OSError` if `fd` is no such memory."""
    size = os.fstat(fd).st_size
    content = os.pread(fd, size, 0)
    if len(content) != size:
        raise OSError(f"only {len(content)} of the {size} bytes of shared memory can be read")
    return content
