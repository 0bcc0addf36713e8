"""Log lines that leave without waiting; what cannot leave is counted.

Under systemd each line is a datagram to the journal, sent without blocking, with fields by which
it is found. Elsewhere the helper process writes it to standard error, which may be a pipe that
nobody reads or a halted terminal.
"""

import logging
import os
import socket
from collections.abc import Callable

JOURNAL_SOCKET = "/run/systemd/journal/socket"
_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_DEBUG_PRIORITY = 7

FIELDS = "journal_fields"
"""The attribute of a log record that maps names of fields to values: `extra={FIELDS: {...}}`."""


class LogHandler(logging.Handler):
    """Hands each line to a sink that never waits and says whether it took the line."""

    def __init__(self, sink: Callable[[logging.LogRecord, str], bool]) -> None:
        super().__init__()
        self.dropped = 0
        self._sink = sink

    def emit(self, record: logging.LogRecord) -> None:
        """Send one line; one that cannot be made or sent is counted."""
        try:
            taken = self._sink(record, self.format(record))
        except Exception:  # noqa: BLE001 - a badly written log call must not end a tick
            taken = False
        self.dropped += not taken


class PriorityFormatter(logging.Formatter):
    """For lines that reach the journal by standard error: the journal takes "<3>" in front off."""

    def format(self, record: logging.LogRecord) -> str:
        """Put the priority in front."""
        return f"<{_priority(record)}>{super().format(record)}"


class JournalSink:
    """Sends lines to the journal in its native form; every one has the channel as a field."""

    def __init__(self, channel: str) -> None:
        self._channel = channel
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def __call__(self, record: logging.LogRecord, text: str) -> bool:
        """Send a line; False when the journal does not take it now."""
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
        """Give the socket back."""
        self._socket.close()


def _priority(record: logging.LogRecord) -> int:
    return next((p for level, p in _PRIORITIES if record.levelno >= level), _DEBUG_PRIORITY)


def _field(name: str, value: str) -> bytes:
    """Encode with the length in front: whatever is in the value, it is no other field."""
    content = value.encode(errors="replace")
    return name.encode() + b"\n" + len(content).to_bytes(8, "little") + content + b"\n"


def goes_to_journal() -> bool:
    """Whether standard error is the journal, as the environment of a systemd unit tells."""
    try:
        device, inode = map(int, os.environ.get("JOURNAL_STREAM", "").split(":"))
        status = os.fstat(2)
    except (ValueError, OSError):
        return False
    return (status.st_dev, status.st_ino) == (device, inode)
