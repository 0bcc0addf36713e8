"""Who is at the other end of a Unix socket: asked of the kernel, never of the peer itself."""

import ctypes
import os
import socket
import struct

from litegripd.rpc.sessions import Peer

SO_PEERGROUPS = 59
"""Of Linux 4.13 and later; the standard library has no name for it."""

_UCRED = struct.Struct("3i")
_GID_BYTES = 4
_COMM_BYTES = 128  # more than any process is called, kernel threads included

_libc = ctypes.CDLL(None)
_libc.getsockopt.argtypes = (
    ctypes.c_int,
    ctypes.c_int,
    ctypes.c_int,
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint32),
)


def peer_of(connected: socket.socket) -> Peer:
    """Return who connected, with the groups that the process had when it did."""
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    pid, uid, gid = _UCRED.unpack(credentials)
    return Peer(pid, uid, gid, _program(pid), _groups(connected))


def _program(pid: int) -> str:
    """Return the name of a process as /proc tells it, in which only printable characters are.

    By plain system calls: a file object costs seven times as much, and every connection pays.
    """
    try:
        fd = os.open(f"/proc/{pid}/comm", os.O_RDONLY)
        try:
            name = os.read(fd, _COMM_BYTES)
        finally:
            os.close(fd)
    except OSError:
        return "?"  # ended meanwhile, or in another pid namespace
    text = name.decode("utf-8", errors="replace").strip()
    return "".join(c if c.isprintable() else "?" for c in text)


def _groups(connected: socket.socket) -> tuple[int, ...]:
    """Return the supplementary groups, however many; none where the kernel does not tell them.

    `socket.getsockopt` takes at most 1024 bytes, which a user of a large directory may exceed.
    """
    size = ctypes.c_uint32(0)
    question = (connected.fileno(), socket.SOL_SOCKET, SO_PEERGROUPS)
    _libc.getsockopt(*question, None, ctypes.byref(size))  # refused, but now `size` is known
    groups = (ctypes.c_uint32 * (size.value // _GID_BYTES))()
    if _libc.getsockopt(*question, groups, ctypes.byref(size)) != 0:
        return ()
    return tuple(groups)
