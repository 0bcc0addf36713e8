"""Standard error that nobody reads: full pipes, stopped terminals, readers that are gone."""

import contextlib
import fcntl
import logging
import os
import pty
import re
import select
import termios
import time
from collections.abc import Callable, Iterator

import pytest

from litegripd.io import log as log_module
from litegripd.io.log import BoundedHandler, LineWriter

DEADLINE_S = 30.0


def until(condition: Callable[[], bool]) -> None:
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s, "did not happen in time"
        select.select((), (), (), 0.002)


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    yield reader, writer
    for descriptor in (reader, writer):
        with contextlib.suppress(OSError):
            os.close(descriptor)


def fill(writer: int) -> int:
    """Fill a pipe; return how many bytes it holds."""
    os.set_blocking(writer, False)
    count = 0
    with contextlib.suppress(BlockingIOError):
        while True:
            count += os.write(writer, b"." * 1000)
    os.set_blocking(writer, True)
    return count + top_up(writer)


def top_up(writer: int) -> int:
    """Fill what is left of a pipe by single bytes."""
    os.set_blocking(writer, False)
    count = 0
    with contextlib.suppress(BlockingIOError):
        while True:
            count += os.write(writer, b".")
    os.set_blocking(writer, True)
    return count


def empty(reader: int) -> bytes:
    found = b""
    while select.select([reader], [], [], 0.1)[0]:
        found += os.read(reader, 65536)
    return found


def test_lines_are_written_in_their_order(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    lines = LineWriter(writer)
    for number in range(100):
        lines.write(f"line {number} \udcff\n")
    assert lines.finish(DEADLINE_S)
    assert (lines.is_busy, lines.is_stuck, lines.lost) == (False, False, 0)
    written = os.read(reader, 65536).splitlines()
    assert written == [b"line %d \\udcff" % number for number in range(100)]


def test_a_full_pipe_keeps_nobody_waiting_and_what_is_lost_is_said(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    fill(writer)
    lines = LineWriter(writer)
    began_s = time.monotonic()
    for _ in range(400):
        lines.write("x" * 999 + "\n")
    assert not lines.finish(0.01)
    assert time.monotonic() - began_s < 10.0
    until(lambda: lines.is_stuck)
    lost = lines.lost
    assert 400 - lost == pytest.approx(log_module.MOST_WAITING_BYTES // 1000, abs=2)
    found = b""
    while not lines.finish(0.05):
        found += empty(reader)
    assert not lines.is_stuck
    lines.write("again\n")
    assert lines.finish(DEADLINE_S)
    found += empty(reader)
    assert found.endswith(b"again\n")
    reported = re.findall(rb"(\d+) log lines were lost", found)
    assert sum(map(int, reported)) == lost, "in two parts where the thread began late"


def test_a_terminal_that_is_stopped_keeps_nobody_waiting() -> None:
    ours, theirs = pty.openpty()
    termios.tcflow(theirs, termios.TCOOFF)  # as Ctrl-S does
    try:
        lines = LineWriter(theirs)
        lines.write("while it is stopped\n")
        until(lambda: lines.is_stuck)
        termios.tcflow(theirs, termios.TCOON)
        assert lines.finish(DEADLINE_S)
        assert b"while it is stopped" in os.read(ours, 1000)
    finally:
        os.close(theirs)
        os.close(ours)


def test_a_reader_that_is_gone_is_no_obstacle(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    os.close(reader)
    lines = LineWriter(writer)
    lines.write("lost\n")
    assert lines.finish(DEADLINE_S)
    assert lines.lost == 1


def test_the_control_process_drops_a_line_that_is_not_taken(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    fill(writer)
    handler = BoundedHandler()
    with os.fdopen(os.dup(writer), "w", encoding="utf-8") as stream:
        handler.setStream(stream)
        log = logging.Logger("ends")
        log.addHandler(handler)
        began_s = time.monotonic()
        for number in range(100):
            log.error("line %d", number)
        assert time.monotonic() - began_s < 20 * log_module.WRITE_WITHIN_S
        empty(reader)
        log.error("the last one")
        assert os.read(reader, 1000) == b"the last one\n"
