"""Delays every start of a program by a daemon's processes, as a slow disk or a full memory does.

The kernel holds each `execve` until a thread of the test lets it go on: seccomp with a listener
(Linux 5.5), which needs no rights. `SlowExec.delay_s` may be changed at any time.
"""

import array
import contextlib
import fcntl
import os
import platform
import select
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

_SYSTEM_CALLS = {"x86_64": (317, 59, 322), "aarch64": (277, 221, 281)}
"""The numbers of seccomp, execve and execveat."""

_RECEIVE = 0xC0502100  # SECCOMP_IOCTL_NOTIF_RECV
_ANSWER = 0xC0182101  # SECCOMP_IOCTL_NOTIF_SEND
_NOTICE_BYTES = 80
_CONTINUE = 1

LAUNCHER = """
import array, ctypes, os, socket, struct, sys
path, seccomp, *calls = sys.argv[1], *map(int, sys.argv[2:5])
libc = ctypes.CDLL(None, use_errno=True)
assert libc.prctl(38, 1, 0, 0, 0) == 0
row = struct.Struct("HBBI")
rows = [row.pack(0x20, 0, 0, 0)]  # the system call's number
rows += [row.pack(0x15, 3 - n, 0, call) for n, call in enumerate(calls, 1)]
rows += [row.pack(0x06, 0, 0, 0x7FFF0000), row.pack(0x06, 0, 0, 0x7FC00000)]
code = ctypes.create_string_buffer(b"".join(rows))
program = ctypes.create_string_buffer(struct.pack("HP", len(rows), ctypes.addressof(code)))
listener = libc.syscall(seccomp, 1, 8, program)
told = socket.socket(socket.AF_UNIX)
told.connect(path)
if listener < 0:
    told.send(os.strerror(ctypes.get_errno()).encode())
    sys.exit(1)
socket.send_fds(told, [b"on"], [listener])
told.close()
os.execv(sys.executable, [sys.executable, "-m", "litegripd.app.main", *sys.argv[5:]])
"""


class UnavailableError(RuntimeError):
    """This kernel, or what confines the tests, does not let them do it; the message says why."""


class SlowExec:
    """Serves one process tree; `count` is how many programs have been started in it."""

    def __init__(self, folder: Path) -> None:
        self.delay_s = 0.0
        self.count = 0
        machine = platform.machine()
        if machine not in _SYSTEM_CALLS:
            raise UnavailableError(f"system calls of {machine} are not known here")
        path = folder / "slow.sock"
        numbers = map(str, _SYSTEM_CALLS[machine])
        self.program = ("-c", LAUNCHER, str(path), *numbers)
        """The arguments of an interpreter that runs the daemon with the arguments behind them."""
        self._ended = threading.Event()
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.bind(str(path))
        self._socket.listen()
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Wait for the process, and serve it; raises `UnavailableError`."""
        self._socket.settimeout(30.0)
        connected, _address = self._socket.accept()
        with connected:
            connected.settimeout(30.0)
            text, descriptors, _flags, _from = socket.recv_fds(connected, 100, 1)
        if not descriptors:
            raise UnavailableError(f"seccomp: {text.decode()}")
        self._thread = threading.Thread(target=self._serve, args=(descriptors[0],))
        self._thread.start()

    def close(self) -> None:
        """Serve no longer; call it when the processes have ended."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        self._socket.close()

    def _serve(self, listener: int) -> None:
        poll = select.poll()
        poll.register(listener, select.POLLIN)
        while not self._ended.is_set():
            if not any(mask & select.POLLIN for _fd, mask in poll.poll(50)):
                continue
            notice = array.array("B", bytes(_NOTICE_BYTES))
            with contextlib.suppress(OSError):  # whoever asked has been killed meanwhile
                fcntl.ioctl(listener, _RECEIVE, notice)
                (identity,) = struct.unpack_from("Q", notice)
                self._ended.wait(self.delay_s)
                self.count += 1
                answer = struct.pack("QqiI", identity, 0, 0, _CONTINUE)
                fcntl.ioctl(listener, _ANSWER, answer)
        os.close(listener)


@contextlib.contextmanager
def slow_exec(folder: Path) -> Iterator[SlowExec]:
    """Make one, and end its thread."""
    made = SlowExec(folder)
    try:
        yield made
    finally:
        made.close()
