"""A daemon's lines as the gateway takes them: whole, in order, and until it goes."""

import asyncio
import contextlib
import socket
from collections.abc import Callable
from typing import Any

import pytest

from litegrip_fleet.far.daemon import Lines
from litegrip_fleet.wire.daemon_lines import MAX_ANSWER_BYTES


async def met(daemon: Callable[[asyncio.StreamWriter], Any], take: Callable[[bytes], None]) -> None:
    """Read the answer to hello, then follow the lines of a daemon until their end."""
    ours, theirs = socket.socketpair()
    loop = asyncio.get_running_loop()
    lines = (await loop.create_connection(Lines, sock=ours))[1]
    _reader, daemons = await asyncio.open_connection(sock=theirs)
    daemons.write(b"hello\nfirst\nsec")
    await daemons.drain()
    assert await lines.readline() == b"hello\n"
    said = asyncio.create_task(daemon(daemons))
    try:
        await asyncio.wait_for(lines.follow(take), 30.0)
    finally:
        with contextlib.suppress(ConnectionError):  # it has been left
            await said
        assert lines.transport.is_closing()


async def goes_on(writer: asyncio.StreamWriter) -> None:
    for piece in (b"ond\n", b"third\nfou", b"rth", b"\n", b"\n", b"the rest"):
        writer.write(piece)
        await writer.drain()
        await asyncio.sleep(0)
    writer.close()


def test_each_line_is_taken_once_whole_and_in_order_the_first_one_too() -> None:
    lines: list[bytes] = []
    asyncio.run(met(goes_on, lines.append))
    assert lines == [b"first\n", b"second\n", b"third\n", b"fourth\n", b"\n", b"the rest"]


def test_a_long_line_is_taken_and_one_beyond_all_bounds_ends_them() -> None:
    lines: list[bytes] = []

    async def says(writer: asyncio.StreamWriter) -> None:
        writer.write(b"ond\n" + b"x" * (MAX_ANSWER_BYTES - 10) + b"\n" + b"y" * MAX_ANSWER_BYTES)
        writer.write(b"y" * 300_000)
        writer.close()

    with pytest.raises(ValueError, match="a line of more than"):
        asyncio.run(met(says, lines.append))
    assert [len(line) for line in lines] == [6, 7, MAX_ANSWER_BYTES - 9]


def test_a_defect_in_what_takes_them_ends_them_and_is_not_hidden() -> None:
    def take(line: bytes) -> None:
        if line == b"third\n":
            raise KeyError("third")

    with pytest.raises(KeyError, match="third"):
        asyncio.run(met(goes_on, take))


def test_a_daemon_that_goes_before_it_has_answered_is_at_its_end_at_once() -> None:
    async def scene() -> list[bytes]:
        ours, theirs = socket.socketpair()
        loop = asyncio.get_running_loop()
        lines = (await loop.create_connection(Lines, sock=ours))[1]
        theirs.sendall(b"one\ntwo")
        theirs.close()
        found = [await asyncio.wait_for(lines.readline(), 30.0) for _ in range(3)]
        await asyncio.wait_for(lines.follow(found.append), 30.0)
        return found

    assert asyncio.run(scene()) == [b"one\n", b"two", b""]
