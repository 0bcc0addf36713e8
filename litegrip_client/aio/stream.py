"""Lines over a Unix stream socket, on asyncio, nothing else: no JSON, no ids."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
from collections.abc import Callable

from litegrip_client.stream import peer_pid

_RETRY_S = 0.01
_READ_BYTES = 65_536


class LineStream(asyncio.Protocol):
    """A connected socket. `on_lines` is called with the complete lines that came together.

    `on_change` is called when `ended` or `is_full` (of what the daemon does not read) changes.
    `peer_pid` is the process at the other end, once connected.
    """

    def __init__(
        self, on_lines: Callable[[list[bytes]], None], on_change: Callable[[], None]
    ) -> None:
        """Nothing is connected yet."""
        self.ended = False
        self.is_full = False
        self.peer_pid = 0
        self._on_lines = on_lines
        self._on_change = on_change
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._transport: asyncio.WriteTransport | None = None
        self._rest = b""

    async def connect(self, path: str, timeout_s: float) -> None:
        """Connect to `path`; raises `OSError` when that fails or takes over `timeout_s`."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        try:
            self._socket.setblocking(False)
            # asyncio would take a full queue of the daemon for a success.
            while (number := self._socket.connect_ex(path)) == errno.EAGAIN:
                if loop.time() >= deadline_s:
                    break
                await asyncio.sleep(_RETRY_S)
            if number != 0:
                raise OSError(number, os.strerror(number))
            self.peer_pid = peer_pid(self._socket)
            await loop.create_unix_connection(lambda: self, sock=self._socket)
        except BaseException:
            self._socket.close()
            raise

    def send(self, line: bytes) -> None:
        """Send a line with its newline, or keep it to be sent; nothing when it has ended."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(line)

    def abort(self) -> None:
        """End the connection soon; `ended` reports its end. What waits to be sent is dropped."""
        if self._transport is not None:
            self._transport.abort()

    def close_here(self) -> None:
        """Close the socket without the event loop, which is gone, or a parent process's."""
        self._socket.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Note what sends."""
        if isinstance(transport, asyncio.WriteTransport):
            self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Hand on the lines that are complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if lines:
            self._on_lines(lines)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note the end, after what the daemon said before a sending failed."""
        if exc is not None:
            with contextlib.suppress(OSError):
                while data := self._socket.recv(_READ_BYTES):
                    self.data_received(data)
        self.ended = True
        self._on_change()

    def pause_writing(self) -> None:
        """Note that the daemon does not read."""
        self.is_full = True
        self._on_change()

    def resume_writing(self) -> None:
        """Note that it reads again."""
        self.is_full = False
        self._on_change()
