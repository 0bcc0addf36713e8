"""Standard error that perhaps nobody reads: a full pipe, or a terminal that Ctrl-S has stopped.

A write to it can wait for ever. `LineWriter` leaves that wait to a thread, in the helper process;
`BoundedHandler` is for the control process, before and after its loop, where a thread has no place.
"""

import logging
import os
import select
import threading
import time
from collections import deque
from typing import TextIO

STUCK_AFTER_S = 1.0
"""A line that has waited so long for its reader is taken for stuck."""

MOST_WAITING_BYTES = 262_144
WRITE_WITHIN_S = 0.5


class LineWriter:
    """Writes lines to a descriptor in a thread of its own, which begins with the first line.

    `lost` counts the lines that found no room behind those that wait, and those that could not be
    written. The next line that can be says how many these were.
    """

    def __init__(self, descriptor: int = 2) -> None:
        self.lost = 0
        self._descriptor = descriptor
        self._lines: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._reported = 0
        self._since_s: float | None = None
        self._condition = threading.Condition()
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """True while a line waits, or is being written."""
        with self._condition:
            return bool(self._lines) or self._since_s is not None

    @property
    def is_stuck(self) -> bool:
        """True while a line has waited for `STUCK_AFTER_S` or longer to be written."""
        with self._condition:
            since_s = self._since_s
        return since_s is not None and time.monotonic() - since_s >= STUCK_AFTER_S

    def write(self, text: str) -> None:
        """Have `text`, which ends in a newline, written; never waits."""
        line = text.encode(errors="backslashreplace")
        with self._condition:
            if self._waiting_bytes + len(line) > MOST_WAITING_BYTES:
                self.lost += 1
                return
            self._lines.append(line)
            self._waiting_bytes += len(line)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()
            self._condition.notify_all()

    def finish(self, within_s: float) -> bool:
        """Wait until all is written, at most `within_s`; return False if it is not."""
        with self._condition:
            return self._condition.wait_for(
                lambda: not self._lines and self._since_s is None, within_s
            )

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._lines)
                line = self._lines.popleft()
                self._waiting_bytes -= len(line)
                self._since_s = time.monotonic()
                line = self._note_of_lost() + line
            is_written = self._is_written(line)
            with self._condition:
                self.lost += not is_written
                self._since_s = None
                self._condition.notify_all()

    def _note_of_lost(self) -> bytes:
        unreported, self._reported = self.lost - self._reported, self.lost
        if unreported == 0:
            return b""
        return b"litegripd: %d log lines were lost: standard error was not read\n" % unreported

    def _is_written(self, line: bytes) -> bool:
        try:
            while line:
                line = line[os.write(self._descriptor, line) :]
        except OSError:  # its reader is gone
            return False
        return True


class BoundedHandler(logging.StreamHandler[TextIO]):
    """Writes a line if the stream takes it within `WRITE_WITHIN_S`, and drops it otherwise.

    After one that was dropped none is waited for, until one can be written again.
    """

    def __init__(self) -> None:
        super().__init__()
        self._within_s = WRITE_WITHIN_S

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, or drop it."""
        is_ready = self._is_ready()
        self._within_s = WRITE_WITHIN_S if is_ready else 0.0
        if is_ready:
            super().emit(record)

    def _is_ready(self) -> bool:
        try:
            descriptor = self.stream.fileno()
        except (OSError, ValueError):  # in memory: that never waits
            return True
        poll = select.poll()
        poll.register(descriptor, select.POLLOUT)
        return bool(poll.poll(self._within_s * 1e3))
