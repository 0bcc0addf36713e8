"""One client's socket: splits what comes into lines, sends what is queued, within bounds."""

import logging
import re
import select
import socket
import time
from typing import Protocol

from litegripd.io.reactor import Reactor
from litegripd.model.errors import Refusal
from litegripd.rpc.session import Session
from litegripd.rpc.wire import MAX_LINE_BYTES, error_line

_log = logging.getLogger(__name__)

MAX_UNSENT_BYTES = 262_144
_LISTEN = select.EPOLLIN | select.EPOLLRDHUP
_NOT_BLANK = re.compile(rb"\S")

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

    `line` is the next one that waits for its turn, None where there is none, `received_s` the time
    (CLOCK_MONOTONIC) at which its end came. A client that closes only its sending side, as `socat`
    does at the end of its input, still gets the answers that it waits for; a last line without its
    newline counts as one.
    """

    def __init__(
        self, reactor: Reactor, connected: socket.socket, session: Session, owner: Owner
    ) -> None:
        self.session = session
        self.line: bytes | None = None
        self.received_s = 0.0
        self._reactor = reactor
        self._socket = connected
        self._owner = owner
        self._received = b""
        self._taken = 0
        self._unsent = bytearray()
        self._half_closed = False

    def on_event(self, mask: int) -> None:
        """Read, write or close as the kernel tells."""
        if mask & select.EPOLLERR:
            self._owner.drop(self)
            return
        if mask & select.EPOLLOUT:
            self.flush()
        if self.line is None and not self._half_closed:
            self._read()
        if mask & select.EPOLLHUP and self.line is None:
            self._owner.drop(self)  # gone for good; what it sent before, a stop say, is done

    def advance(self) -> None:
        """Go on to the next line of what has been received; blank ones do not count."""
        text = _NOT_BLANK.search(self._received, self._taken)
        begin = len(self._received) if text is None else text.start()
        end = self._received.find(b"\n", begin)
        if end < 0 and self._half_closed and begin < len(self._received):
            end = len(self._received)
        self.line = None if end < 0 else self._received[begin:end]
        if end < 0:
            self._received, self._taken = self._received[begin:], 0
        else:
            self._taken = end + 1
        if len(self._received if self.line is None else self.line) > MAX_LINE_BYTES:
            self._refuse(_TOO_LONG, bytes(self._unsent) + b"".join(self.session.outgoing))
        else:
            self._drop_if_done()

    def flush(self) -> None:
        """Send as much as the client takes now; close a client that lets too much wait."""
        outgoing = self.session.outgoing
        if outgoing:
            self._unsent += b"".join(outgoing)
            outgoing.clear()
        if not self._unsent:
            self._drop_if_done()
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
        self.session.counters.bytes_out += sent
        self.session.congested = bool(self._unsent)
        if len(self._unsent) > MAX_UNSENT_BYTES:
            self._refuse(_BACKLOG_FULL, b"\n")  # ends the line that was cut off
            return
        if self.session.congested != was_congested:
            self._watch()
        self._drop_if_done()

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
        self._received += received
        self.received_s = time.monotonic()  # of all its lines: there is no reading while one waits
        self.session.counters.bytes_in += len(received)
        if not received:
            self._half_closed = True
            self._watch()
        self.advance()
        if self.line is not None:
            self._owner.take_turn(self)

    def _drop_if_done(self) -> None:
        """Close a half-closed connection once nothing is left to be done or told."""
        waits = self.line is not None or self.session.outgoing or self._unsent
        if self._half_closed and not waits and self._owner.is_idle(self):
            self._owner.drop(self)

    def _refuse(self, refusal: Refusal, before: bytes) -> None:
        """Say why in a last line after `before`, and close."""
        self.line = None
        peer = self.session.peer
        _log.warning("closing %s (pid %d): %s", peer.program, peer.pid, refusal.message)
        try:
            # Room for the reason behind what a client that does not read has left no room for.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * MAX_UNSENT_BYTES)
            self._socket.send(before + error_line(None, refusal))
        except OSError as error:
            _log.debug("the reason could not be sent: %s", error)
        self._owner.drop(self)

    def _watch(self) -> None:
        mask = 0 if self._half_closed else _LISTEN
        if self.session.congested:
            mask |= select.EPOLLOUT
        self._reactor.modify(self._socket.fileno(), mask)
