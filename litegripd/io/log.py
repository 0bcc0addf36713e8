"""Log lines that leave without waiting; lines that cannot leave are counted.

Under systemd each line is a datagram to the journal, sent without blocking, with fields for
searching. Elsewhere the helper process writes it to standard error. That may be a full pipe or a
terminal stopped by Ctrl-S, and a write to it can wait forever. `LineWriter` leaves that wait to a
thread of the helper process. `BoundedHandler` is for the control process, before and after its
loop, where a thread has no place.
"""

import logging
import os
import select
import socket
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, TextIO

STUCK_AFTER_S = 1.0
"""A line that has waited this long for its reader counts as stuck."""

MOST_WAITING_BYTES = 262_144
WRITE_WITHIN_S = 0.5


class LineWriter:
    """Writes lines to a descriptor in a thread of its own, which begins with the first line.

    `lost` counts the lines for which the queue had no room, and those that could not be written.
    The next line that can be written reports their number.
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
        """Queue `text`, which ends in a newline; never waits."""
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
        """Wait at most `within_s` until all lines are written; return False if they are not."""
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
                unreported, self._reported = self.lost - self._reported, self.lost
                if unreported:
                    text = b"litegripd: %d log lines were lost: standard error was not read\n"
                    line = text % unreported + line
            is_written = self._is_written(line)
            with self._condition:
                self.lost += not is_written
                self._since_s = None
                self._condition.notify_all()

    def _is_written(self, line: bytes) -> bool:
        try:
            while line:
                line = line[os.write(self._descriptor, line) :]
        except OSError:  # its reader is gone
            return False
        return True


if TYPE_CHECKING:
    _StreamHandler = logging.StreamHandler[TextIO]
else:  # in Python 3.10 it takes no type
    _StreamHandler = logging.StreamHandler


class BoundedHandler(_StreamHandler):
    """Writes a line if the stream takes it within `WRITE_WITHIN_S`, and drops it otherwise.

    After a dropped line it does not wait again until a line can be written.
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
        except (OSError, ValueError):  # in memory: it never waits
            return True
        poll = select.poll()
        poll.register(descriptor, select.POLLOUT)
        return bool(poll.poll(self._within_s * 1e3))


JOURNAL_SOCKET = "/run/systemd/journal/socket"
_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_DEBUG_PRIORITY = 7

FIELDS = "journal_fields"
"""The attribute of a log record that maps names of fields to values: `extra={FIELDS: {...}}`."""


class PriorityFormatter(logging.Formatter):
    """For lines that reach the journal by standard error: the journal removes "<3>" in front."""

    def format(self, record: logging.LogRecord) -> str:
        """Add the priority in front."""
        return f"<{_priority(record)}>{super().format(record)}"


class JournalSink:
    """Sends lines to the journal in its native form; each has the channel as a field."""

    def __init__(self, channel: str) -> None:
        self._channel = channel
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def __call__(self, record: logging.LogRecord, text: str) -> bool:
        """Send a line; False if the journal does not take it now."""
        fields = {
            "PRIORITY": _priority(record),
            "SYSLOG_IDENTIFIER": "litegripd",
            "LITEGRIP_CHANNEL": self._channel,
            **getattr(record, FIELDS, {}),
            "MESSAGE": text,
        }
        datagram = b"".join(_field(name, str(value)) for name, value in fields.items())
        try:
            self._socket.sendto(datagram, JOURNAL_SOCKET)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _priority(record: logging.LogRecord) -> int:
    return next((p for level, p in _PRIORITIES if record.levelno >= level), _DEBUG_PRIORITY)


def _field(name: str, value: str) -> bytes:
    """Encode with the length in front: no value can become another field."""
    content = value.encode(errors="replace")
    return name.encode() + b"\n" + len(content).to_bytes(8, "little") + content + b"\n"


def goes_to_journal() -> bool:
    """Return True if standard error is the journal, as a systemd unit's environment shows."""
    try:
        device, inode = map(int, os.environ.get("JOURNAL_STREAM", "").split(":"))
        status = os.fstat(2)
    except (ValueError, OSError):
        return False
    return (status.st_dev, status.st_ino) == (device, inode)
