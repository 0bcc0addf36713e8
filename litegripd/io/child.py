"""Starts the processes in which whatever can block lives, and notices when they die.

A child talks over a pair of `SOCK_SEQPACKET` sockets, one message a packet, and ends when its
end of the pair reads end-of-file. It runs at ordinary priority and on all CPUs.
"""

import contextlib
import os
import select
import signal
import socket
import struct
import sys
from collections.abc import Callable, Sequence
from typing import TypeVar

CHILD_FD = 3
MEMORY_FD = 4
"""Where a child finds its socket, and the shared memory, if it was given one."""

T = TypeVar("T")

_DESCRIPTOR = struct.Struct("i")
_BUFFER_BYTES = 212_992  # the kernel's usual ceiling without privileges (net.core.wmem_max)
MAX_PACKET_BYTES = 65_536

_RUN = """import sys; sys.path[:] = {path!r}; import runpy
runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)"""


def module_command(module: str, arguments: Sequence[str] = ()) -> list[str]:
    """Return what runs `module` from where this process has its own modules.

    `python -m module` would look in the current directory first, and run what lies there: any
    `json.py`, for one.
    """
    return [sys.executable, "-c", _RUN.format(path=sys.path), module, *arguments]


class Child:
    """One running child process: a non-blocking socket to it and a pidfd that tells its end."""

    def __init__(
        self, module: str, arguments: Sequence[str] = (), memory_fd: int | None = None
    ) -> None:
        """Run `module` with its arguments; raises `OSError` when that is impossible."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        self.socket = ours
        inherited: list[tuple[int, int, int]] = [
            (os.POSIX_SPAWN_DUP2, theirs.fileno(), CHILD_FD),
        ]
        if memory_fd is not None:
            inherited.append((os.POSIX_SPAWN_DUP2, memory_fd, MEMORY_FD))
        try:
            self.pid = os.posix_spawn(
                sys.executable,
                module_command(module, arguments),
                os.environ,
                file_actions=inherited,
                setpgroup=0,  # a Ctrl-C in the terminal is for the daemon, which ends its children
                # For the daemon alone, though sent to all of its processes: a stop, its end, in
                # which the pump still has to disable the motor, and what a manager's watchdog
                # sends, after which the helper still has to write what happened.
                setsigmask=(signal.SIGUSR1, signal.SIGTERM, signal.SIGABRT),
                setsigdef=(signal.SIGPIPE, signal.SIGINT, signal.SIGTERM),
            )
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        self.pidfd = os.pidfd_open(self.pid)

    @classmethod
    def of(cls, pid: int, connected: socket.socket, pidfd: int) -> "Child":
        """Return a child that another process of the daemon has started and handed over."""
        child = cls.__new__(cls)
        connected.setblocking(False)
        child.socket, child.pid, child.pidfd = connected, pid, pidfd
        return child

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
            return self.socket.recv(MAX_PACKET_BYTES) or None
        except (BlockingIOError, ConnectionError):
            return None

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended (without waiting)."""
        return bool(select.select((self.pidfd,), (), (), 0)[0])

    def close(self, grace_s: float = 0.0) -> None:
        """Close the pair, end the process and reap it; waits for its end.

        It has `grace_s` to finish what it was sent and to end by itself. One that was handed over
        is reaped by whoever got it when its parent ended.
        """
        self.socket.close()
        if not select.select((self.pidfd,), (), (), grace_s)[0]:
            signal.pidfd_send_signal(self.pidfd, signal.SIGKILL)
            select.select((self.pidfd,), (), ())
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self.pid, 0)
        os.close(self.pidfd)

    def let_go(self) -> None:
        """Close our end and leave the process to the one that has got its own."""
        self.socket.close()
        os.close(self.pidfd)


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
    """Leave the control thread's CPUs, which a child that it has started inherits, to itself."""
    with contextlib.suppress(OSError):  # not allowed: then where it is
        os.sched_setaffinity(0, range(os.cpu_count() or 1))


def _despite_reset(receive: Callable[[], T]) -> T:
    """Receive; a reset, which tells that our words were not read, comes before the last packets."""
    try:
        return receive()
    except ConnectionResetError:
        return receive()
