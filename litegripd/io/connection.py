"""One client's socket: splits what comes into lines, sends what is queued, within bounds."""

import logging
import select
import socket
from typing import Protocol

from litegripd.io.reactor import Reactor
from litegripd.model.errors import Refusal
from litegripd.rpc.session import Session
from litegripd.rpc.wire import MAX_LINE_BYTES, error_line

_log = logging.getLogger(__name__)

MAX_UNSENT_BYTES = 262_144
_LISTEN = select.EPOLLIN | select.EPOLLRDHUP

_TOO_LONG = Refusal(
    "line_too_long",
    f"a line is longer than {MAX_LINE_BYTES} bytes: send large contents in pieces",
    {"limit": MAX_LINE_BYTES},
)
_BACKLOG_FULL = Refusal(
    "backlog_full",
    f"more than {MAX_UNSENT_BYTES} bytes wait to be read by this client",
    {"limit": MAX_UNSENT_BYTES},
)


class Owner(Protocol):
    """The server, as a connection needs it."""

    def take_turn(self, connection: "Connection") -> None:
        """Serve the connection's lines in its turn."""

    def drop(self, connection: "Connection") -> None:
        """Close the connection for good."""

    def is_idle(self, connection: "Connection") -> bool:
        """Whether nothing more will be sent to it by itself."""


class Connection:
    """A client that has been let in.

    `lines` are read and wait for their turn. A client that closes only its sending side, as
    `socat` does at the end of its input, still gets the answers that it waits for.
    """

    def __init__(
        self, reactor: Reactor, connected: socket.socket, session: Session, owner: Owner
    ) -> None:
        self.session = session
        self.lines: list[bytes] = []
        self.requests = 0
        self._reactor = reactor
        self._socket = connected
        self._owner = owner
        self._partial = b""
        self._unsent = bytearray()
        self._half_closed = False

    def on_event(self, mask: int) -> None:
        """Read, write or close as the kernel tells."""
        if mask & (select.EPOLLHUP | select.EPOLLERR):
            self._owner.drop(self)
            return
        if mask & select.EPOLLOUT:
            self.flush()
        if mask & (select.EPOLLIN | select.EPOLLRDHUP) and not self.lines:
            self._read()

    def flush(self) -> None:
        """Send as much as the client takes now; close a client that lets too much wait."""
        outgoing = self.session.outgoing
        if outgoing:
            self._unsent += b"".join(outgoing)
            outgoing.clear()
        if not self._unsent:
            return
        was_congested = self.session.congested
        try:
            sent = self._socket.send(self._unsent)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._owner.drop(self)  # the client is gone
            return
        del self._unsent[:sent]
        self.session.congested = bool(self._unsent)
        if len(self._unsent) > MAX_UNSENT_BYTES:
            self._refuse(_BACKLOG_FULL)
        elif self.session.congested != was_congested:
            self._watch()
        if self._half_closed and not self._unsent and self._owner.is_idle(self):
            self._owner.drop(self)

    def close(self) -> None:
        """Close the socket; what was not sent is lost."""
        self._reactor.remove(self._socket.fileno())
        self._socket.close()

    def _read(self) -> None:
        try:
            received = self._socket.recv(MAX_LINE_BYTES + 1)
        except BlockingIOError:
            return
        except OSError:
            self._owner.drop(self)
            return
        if not received:
            self._half_closed = True
            self._watch()
            self.flush()
            if not self._unsent and self._owner.is_idle(self):
                self._owner.drop(self)
            return
        *lines, self._partial = (self._partial + received).split(b"\n")
        if len(self._partial) > MAX_LINE_BYTES or any(len(ln) > MAX_LINE_BYTES for ln in lines):
            self._refuse(_TOO_LONG)
            return
        self.lines = [line for line in lines if line.strip()]
        if self.lines:
            self._owner.take_turn(self)

    def _refuse(self, refusal: Refusal) -> None:
        """Say why in a last line, as far as the client takes it, and close."""
        peer = self.session.peer
        _log.warning("closing %s (pid %d): %s", peer.program, peer.pid, refusal.message)
        try:
            self._socket.send(b"\n" + error_line(None, refusal))  # ends a line cut off half-way
        except OSError as error:
            _log.debug("the reason could not be sent: %s", error)
        self._owner.drop(self)

    def _watch(self) -> None:
        mask = 0 if self._half_closed else _LISTEN
        if self.session.congested:
            mask |= select.EPOLLOUT
        self._reactor.modify(self._socket.fileno(), mask)
