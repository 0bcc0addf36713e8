"""A client's bare connection, for who sends anything at all; it checks what comes back."""

import json
import socket
from pathlib import Path
from typing import Any

DEADLINE_S = 60.0


class BrokenPromiseError(RuntimeError):
    """The daemon did not do what it promises to every client."""


def expect(kept: bool, what: object) -> None:
    """Raise `BrokenPromiseError` where a promise is not kept."""
    if not kept:
        raise BrokenPromiseError(what)


class Connection:
    """One connection, of raw lines."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(DEADLINE_S)
        self.socket.connect(str(path))
        self._lines = self.socket.makefile("rb")

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        self._lines.close()
        self.socket.close()

    def send(self, data: bytes) -> bool:
        """Send; tell whether the daemon has not closed the connection."""
        try:
            self.socket.sendall(data)
        except (BrokenPipeError, ConnectionResetError):
            return False
        return True

    def line(self) -> bytes:
        """Return the next line; nothing at the end."""
        try:
            return self._lines.readline()
        except ConnectionResetError:  # closed before it had read all that was sent
            return b""

    def message(self) -> dict[str, Any]:
        """Return the next message, an empty one at the end."""
        line = self.line()
        message: dict[str, Any] = json.loads(line) if line else {}
        if "error" in message:
            check_error(message["error"])
        return message

    def last_message(self) -> dict[str, Any]:
        """Read up to the end; return the last line, which tells why, though one before be cut."""
        last = b""
        while line := self.line():
            last = line
        message: dict[str, Any] = json.loads(last) if last else {}
        return message


def check_error(error: dict[str, Any]) -> None:
    """Check that an error says what it is, and is no defect."""
    reason = error.get("data", {}).get("reason")
    is_whole = isinstance(error.get("code"), int) and bool(error.get("message"))
    expect(is_whole and isinstance(reason, str) and reason != "internal_error", error)


def reason_of(message: dict[str, Any]) -> str | None:
    """Return the reason of an error, if it is one."""
    reason: str | None = message.get("error", {}).get("data", {}).get("reason")
    return reason
