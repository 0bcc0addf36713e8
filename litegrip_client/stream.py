"""Lines over a Unix stream socket, nothing else: no JSON, no ids, no threads.

What is read stays here until the reader says that it is done with it (`keep`), so that a
KeyboardInterrupt between reading and handling loses nothing.
"""

import math
import select
import socket
import struct
import threading
import time

SLICE_S = 0.5
"""The longest that one `receive` waits."""

_CREDENTIALS = struct.Struct("3i")
_READ_BYTES = (32_768,)
_BLOCKING = (0,)
_NOT_BLOCKING = (socket.MSG_DONTWAIT,)


class StreamEndedError(Exception):
    """The other side closed the connection."""


class LineStream:
    """A connected socket. Sending is for any thread; one thread at a time may receive."""

    __slots__ = ("_chunks", "_cut", "_send_lock", "_socket", "peer_pid")

    def __init__(self, path: str, timeout_s: float) -> None:
        """Connect to `path`; raises `OSError` when that fails or takes over `timeout_s`."""
        self._socket = _connected(path, timeout_s)
        self.peer_pid = peer_pid(self._socket)
        self._chunks: list[bytes] = []
        self._send_lock = threading.RLock()
        self._cut = False

    def send(self, line: bytes, timeout_s: float) -> None:
        """Send one line with its newline.

        Raises `OSError` when the connection is gone and `TimeoutError` when the daemon does not
        take the line in time.
        """
        with self._send_lock:
            if self._cut:
                raise OSError("an earlier line was cut off half-way: connect anew")
            try:
                sent = self._socket.send(line, socket.MSG_DONTWAIT)
            except BlockingIOError:
                sent = 0
            if sent < len(line):
                self._send_rest(line[sent:], timeout_s, cut=sent > 0)

    def _send_rest(self, line: bytes, timeout_s: float, *, cut: bool) -> None:
        deadline_s = time.monotonic() + timeout_s
        self._cut = cut
        while line:
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0.0 or not self._ready(select.POLLOUT, remaining_s):
                raise TimeoutError("the daemon does not read")
            self._cut = True
            line = line[self._socket.send(line, socket.MSG_DONTWAIT) :]
        self._cut = False

    def receive(self, wait_s: float) -> tuple[list[bytes], bytes]:
        """Wait at most `wait_s` and `SLICE_S`; return the complete lines and the incomplete rest.

        The same lines come again unless `keep(rest)` is called when they are handled. Raises
        `StreamEndedError` at the end of the stream.
        """
        if not any(b"\n" in chunk for chunk in self._chunks):
            self._fill(wait_s)
        *lines, rest = b"".join(self._chunks).split(b"\n")
        return lines, rest

    def _fill(self, wait_s: float) -> None:
        flags = _BLOCKING  # the socket's own time limit is SLICE_S: one system call does it
        try:
            if wait_s < SLICE_S:
                if not self._ready(select.POLLIN, wait_s):
                    return
                flags = _NOT_BLOCKING
            # In one C call, so that no interrupt can come between reading and storing.
            self._chunks.extend(map(self._socket.recv, _READ_BYTES, flags))
        except BlockingIOError:
            return
        except (OSError, ValueError) as error:  # ValueError: closed by another thread
            raise StreamEndedError from error
        if not self._chunks[-1]:
            raise StreamEndedError

    def keep(self, rest: bytes) -> None:
        """Forget all that was received except `rest`."""
        self._chunks[:] = [rest] if rest else []

    @property
    def hung_up(self) -> bool:
        """True if the other side is gone, as far as the kernel knows."""
        poller = select.poll()
        poller.register(self._socket, select.POLLRDHUP)
        return bool(poller.poll(0))

    def _ready(self, event: int, wait_s: float) -> bool:
        # A new object each time: one object must not be used twice at once, and a signal handler
        # can run while this waits.
        poller = select.poll()
        poller.register(self._socket, event)
        return bool(poller.poll(None if math.isinf(wait_s) else math.ceil(wait_s * 1000.0)))

    def close(self, *, shared: bool = False) -> None:
        """Close the socket; `shared`: another process uses it, too, and must not notice."""
        if not shared:
            try:
                self._socket.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits for it
            except OSError:
                self._chunks.clear()  # was closed already, by the daemon or by us
        self._socket.close()


def peer_pid(connected: socket.socket) -> int:
    """Return the process that listens at the other end; 0 where the kernel hides it from here."""
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid: int = _CREDENTIALS.unpack(credentials)[0]
    return pid


def _connected(path: str, timeout_s: float) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # A non-blocking connect would fail at once when the daemon's queue is full for a moment.
        _set_limit(connection, socket.SO_SNDTIMEO, timeout_s)
        _set_limit(connection, socket.SO_RCVTIMEO, SLICE_S)
        connection.connect(path)
    except BaseException:
        connection.close()
        raise
    return connection


def _set_limit(connection: socket.socket, option: int, limit_s: float) -> None:
    seconds, fraction = divmod(limit_s, 1.0)
    value = struct.pack("ll", int(seconds), int(fraction * 1e6))
    connection.setsockopt(socket.SOL_SOCKET, option, value)
