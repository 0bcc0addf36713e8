"""A slow way from a browser to the page: a SOCKS proxy that passes so many bytes a second.

The browser's own emulation of slow networks leaves WebSockets alone.
"""

import asyncio
import contextlib
import struct
import threading
from collections.abc import Iterator

from tests.process.daemon_process import DEADLINE_S

PIECE_BYTES = 256


class SlowLink:
    """Passes everything at once until `bytes_per_s` is set; then that much, each way, in all."""

    def __init__(self) -> None:
        self.bytes_per_s: float | None = None
        self.port = 0
        self._free_at_s = [0.0, 0.0]
        self._writers: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        self._listening = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        assert self._listening.wait(DEADLINE_S)

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join(DEADLINE_S)

    def _run(self) -> None:
        with contextlib.closing(self._loop):
            self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        self._ending = asyncio.Event()
        server = await asyncio.start_server(self._meet, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._listening.set()
        await self._ending.wait()
        server.close()
        for writer in self._writers:
            writer.transport.abort()
        await asyncio.gather(*(asyncio.all_tasks() - {asyncio.current_task()}))

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer a greeting of SOCKS 5 (RFC 1928), connect, and pass on what comes."""
        self._writers.add(writer)
        with contextlib.closing(writer), contextlib.suppress(OSError, EOFError):
            _version, methods = await reader.readexactly(2)
            await reader.readexactly(methods)
            writer.write(b"\x05\x00")
            _version, _command, _reserved, kind = await reader.readexactly(4)
            length = {1: 4, 4: 16}.get(kind) or (await reader.readexactly(1))[0]
            await reader.readexactly(length)  # whatever its name, it is this machine
            (port,) = struct.unpack("!H", await reader.readexactly(2))
            there, there_writer = await asyncio.open_connection("127.0.0.1", port)
            self._writers.add(there_writer)
            writer.write(b"\x05\x00\x00\x01" + bytes(6))
            await asyncio.gather(self._pass(0, reader, there_writer), self._pass(1, there, writer))

    async def _pass(
        self, way: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        with contextlib.closing(writer), contextlib.suppress(ConnectionError):
            while piece := await reader.read(PIECE_BYTES):
                if self.bytes_per_s is not None:
                    now_s = self._loop.time()
                    takes_s = len(piece) / self.bytes_per_s
                    self._free_at_s[way] = max(now_s, self._free_at_s[way]) + takes_s
                    await asyncio.sleep(self._free_at_s[way] - now_s)
                writer.write(piece)
                await writer.drain()


@contextlib.contextmanager
def slow_link() -> Iterator[SlowLink]:
    link = SlowLink()
    try:
        yield link
    finally:
        link.close()
