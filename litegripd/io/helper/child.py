"""Starts the processes for work that can block, and notices when they die.

A child talks over a pair of `SOCK_SEQPACKET` sockets, one message a packet, and ends when its end
of the pair reads end-of-file. It runs at ordinary priority and on all CPUs. What it shares with the
daemon besides is a piece of memory.
"""

import contextlib
import fcntl
import mmap
import os
import select
import signal
import socket
import struct
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias, TypeVar

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


CHILD_FD = 3
MEMORY_FD = 4
"""Where a child finds its socket, and the shared memory, if it was given one."""

T = TypeVar("T")

_DESCRIPTOR = struct.Struct("i")
_BUFFER_BYTES = 212_992  # the kernel's usual ceiling without privileges (net.core.wmem_max)
MAX_PACKET_BYTES = 65_536

_PYTHON = str(Path(sys.executable).parent.resolve() / Path(sys.executable).name)
_PATH = [os.path.realpath(directory) for directory in sys.path]
"""Where this version's interpreter and modules are, without links on the way: one that leads to
another version from now on must not mix the two."""

_RUN = os.path.realpath(Path(__file__).with_name("run.py"))


def module_command(module: str, arguments: Sequence[str] = ()) -> list[str]:
    """Return the command that runs `module` from the folder of this process's modules.

    It needs the environment that `module_environment` returns.
    """
    return [_PYTHON, _RUN, module, *arguments]


def module_environment() -> dict[str, str]:
    """Return the environment of a child that runs a module: this one's, and where modules are."""
    return {**os.environ, "LITEGRIPD_MODULES": os.pathsep.join(_PATH)}


class Child:
    """A child process: a non-blocking socket to it, and a pidfd that is readable at its end.

    Both ends of the pair exist before the process does: what is sent meanwhile waits for it. Until
    `settle`, which is called whenever the process is looked at, has learned of the start, `pid` is
    None. `failure` says why the process could not be started; then it counts as ended.
    """

    def __init__(
        self,
        connected: socket.socket,
        pid: int | None = None,
        pidfd: int | None = None,
        settle: Callable[[float], None] = lambda _within_s: None,
    ) -> None:
        connected.setblocking(False)
        self.socket = connected
        self.failure: str | None = None
        self._pid = pid
        self._pidfd = pidfd
        self._settle = settle
        self._is_cut = False

    @property
    def pid(self) -> int | None:
        """The process id, None before the process is known to have started."""
        self._look()
        return self._pid

    @property
    def pidfd(self) -> int | None:
        """The pidfd, None before the process is known to have started."""
        self._look()
        return self._pidfd

    def started(self, pid: int, pidfd: int) -> None:
        """Note the process; its pidfd is closed at once where nobody waits for it."""
        if self.socket.fileno() < 0:
            os.close(pidfd)
        else:
            self._pid, self._pidfd = pid, pidfd

    def send(self, packet: bytes, descriptors: Sequence[int] = ()) -> bool:
        """Send without waiting; False when it is too long or nobody takes it now."""
        if len(packet) > MAX_PACKET_BYTES:
            return False
        try:
            if descriptors:
                socket.send_fds(self.socket, [packet], descriptors)
            else:
                self.socket.send(packet)
        except (BlockingIOError, ConnectionError):
            return False
        return True

    def receive(self) -> bytes | None:
        """Return one packet, or None when there is none now or the child is gone."""
        try:
            packet = self.socket.recv(MAX_PACKET_BYTES)
        except BlockingIOError:
            return None
        except ConnectionError:
            packet = b""
        if packet:
            return packet
        self._is_cut = True
        return None

    @property
    def is_cut(self) -> bool:
        """False while `receive` has found the other end open: then it has not ended either."""
        return self._is_cut or self.pidfd is None

    @property
    def has_ended(self) -> bool:
        """True once the process has ended, or could not be started (without waiting)."""
        pidfd = self.pidfd
        if pidfd is None:
            return self.failure is not None
        return bool(select.select((pidfd,), (), (), 0)[0])

    def close(self, grace_s: float = 0.0) -> None:
        """Close the pair and end the process; waits for its end, and reaps it if it is our own.

        It has `grace_s` to finish what it was sent and to end by itself. One that has not started
        within that time ends by itself when it does.
        """
        self._look(grace_s)
        self.socket.close()
        pidfd, self._pidfd = self._pidfd, None
        if pidfd is None or self._pid is None:
            return
        if not select.select((pidfd,), (), (), grace_s)[0]:
            with contextlib.suppress(ProcessLookupError):  # it has been reaped already
                signal.pidfd_send_signal(pidfd, signal.SIGKILL)
            select.select((pidfd,), (), ())
        with contextlib.suppress(ChildProcessError):  # its parent is another process
            os.waitpid(self._pid, 0)
        os.close(pidfd)

    def let_go(self) -> None:
        """Close our end, and leave the process to the other owner of an end."""
        self.socket.close()
        pidfd, self._pidfd = self._pidfd, None
        if pidfd is not None:
            os.close(pidfd)

    def _look(self, within_s: float = 0.0) -> None:
        if self._pidfd is None and self.failure is None:
            self._settle(within_s)


Start: TypeAlias = Callable[[str, Sequence[str], "int | None"], Child]
"""Starts a module with arguments and, for some, a shared memory; raises `OSError`."""


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Return the daemon's end, which does not block, and the end that a child inherits."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
    return ours, theirs


def start_here(module: str, arguments: Sequence[str] = (), memory_fd: int | None = None) -> Child:
    """Run `module` as a child of this process; raises `OSError` when that is impossible.

    Waits until the new process runs its program, which can take long on a busy machine: not for
    the control thread while a motor is energised. There it is `Spawner.start`.
    """
    ours, theirs = socket_pair()
    try:
        pid = spawn(module, arguments, theirs.fileno(), memory_fd)
    except OSError:
        ours.close()
        raise
    finally:
        theirs.close()
    return Child(ours, pid, os.pidfd_open(pid))


def spawn(
    module: str, arguments: Sequence[str], connected_fd: int, memory_fd: int | None = None
) -> int:
    """Run `module` with its descriptors in place; return its pid, raise what `posix_spawn` does."""
    inherited: list[tuple[int, int, int]] = [(os.POSIX_SPAWN_DUP2, connected_fd, CHILD_FD)]
    if memory_fd is not None:
        inherited.append((os.POSIX_SPAWN_DUP2, memory_fd, MEMORY_FD))
    return os.posix_spawn(
        _PYTHON,
        module_command(module, arguments),
        module_environment(),
        file_actions=inherited,
        setpgroup=0,  # a Ctrl-C in the terminal is for the daemon, which ends its children
        # For the daemon alone, though sent to all of its processes: a stop, its end, in
        # which the pump still has to disable the motor, and what a manager's watchdog
        # sends, after which the helper still has to write what happened.
        setsigmask=(signal.SIGUSR1, signal.SIGTERM, signal.SIGABRT),
        setsigdef=(signal.SIGPIPE, signal.SIGINT, signal.SIGTERM),
    )


def receive_descriptors(
    connected: socket.socket, most_bytes: int, most: int
) -> tuple[bytes, list[int]]:
    """Return a packet and the descriptors that came with it, which no child of ours inherits.

    Raises what `recvmsg` raises. `socket.recv_fds` heeds no flags before Python 3.12.
    """
    room = socket.CMSG_SPACE(most * _DESCRIPTOR.size)

    def receive() -> tuple[bytes, list[tuple[int, int, bytes]], int, object]:
        return connected.recvmsg(most_bytes, room, socket.MSG_CMSG_CLOEXEC)

    packet, ancillary, _flags, _address = _despite_reset(receive)
    descriptors: list[int] = []
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
            whole = len(data) - len(data) % _DESCRIPTOR.size
            descriptors += [number for (number,) in _DESCRIPTOR.iter_unpack(data[:whole])]
    return packet, descriptors


def inherited_socket() -> socket.socket:
    """Return the child's own end of the pair, in blocking mode."""
    return socket.socket(fileno=CHILD_FD)


def next_packet(peer: socket.socket) -> bytes:
    """Wait, in a child, for a packet of the daemon; nothing means that it is gone."""
    return _despite_reset(lambda: peer.recv(MAX_PACKET_BYTES))


def use_all_cpus() -> None:
    """Use all CPUs: a child inherits those of the control thread, and must leave them to it."""
    with contextlib.suppress(OSError):  # not allowed: then where it is
        os.sched_setaffinity(0, range(os.cpu_count() or 1))


def _despite_reset(receive: Callable[[], T]) -> T:
    """Receive; a reset (what we sent was not read) comes before the last packets."""
    try:
        return receive()
    except ConnectionResetError:
        return receive()
