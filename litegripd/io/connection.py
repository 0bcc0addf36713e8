"""One client's socket: splits received bytes into lines and sends queued ones, within bounds."""

import fcntl
import logging
import math
import re
import select
import socket
import struct
import termios
import time
from typing import Protocol

from litegripd.io.loop import Reactor
from litegripd.model.errors import Refusal
from litegripd.rpc.jsonrpc import (
    MAX_LINE_BYTES,
    error_line,
    is_set_point,
    newest_set_point,
    stops_in,
)
from litegripd.rpc.sessions import Session

_log = logging.getLogger(__name__)

MAX_UNSENT_BYTES = 262_144
_LISTEN = select.EPOLLIN | select.EPOLLRDHUP
_NOT_BLANK = re.compile(rb"\S")
_INT = struct.Struct("i")
_NEWLINE = ord("\n")
_LAST_BYTES = 65_536
_LAST_READS = 64  # more than any socket's buffer holds
_OVERTAKEN_AT_ONCE = 64
"""At most this many set-points that a newer one has overtaken are left out in one turn."""

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
    """What a connection needs from the server."""

    def take_turn(self, connection: "Connection") -> bool:
        """Queue the connection for its turn; False if it is queued already."""

    def serve_last(self, connection: "Connection", line: bytes) -> None:
        """Serve now a line that must not be lost."""

    def drop(self, connection: "Connection") -> None:
        """Close the connection for good."""

    def is_idle(self, connection: "Connection") -> bool:
        """Return True if nothing more will be sent to it unasked."""


class Connection:
    """A client that has been accepted.

    `line` is the next line to be served, or None. `received_s` is the time (CLOCK_MONOTONIC) by
    which its end had arrived, `waits_since_s` when the daemon noticed that something had arrived. A
    client that closes only its sending side, as `socat` does at the end of its input, still gets
    the answers that it waits for; a last line without its newline counts as one. Unread input of a
    lost client is dropped, except for stops.
    """

    def __init__(
        self, reactor: Reactor, connected: socket.socket, session: Session, owner: Owner
    ) -> None:
        self.session = session
        self.line: bytes | None = None
        self.received_s = 0.0
        self.waits_since_s = 0.0
        self._noticed_s: float | None = None
        self._reactor = reactor
        self._socket = connected
        self._owner = owner
        self._received = b""
        self._begin = 0  # of `line`
        self._taken = 0
        self._newest = -1  # where the newest set-point begins
        self._came_s = 0.0
        self._unread = 0  # bytes that are known to be in the kernel, and by when they were
        self._unread_s = 0.0
        self._unsent = bytearray()
        self._sent_whole = True
        self._half_closed = False
        self.is_heard = True
        """True while the loop watches for more to read."""

    def on_event(self, mask: int) -> None:
        """Wait for a turn to read, write, or close, as the kernel reports."""
        if mask & (select.EPOLLERR | select.EPOLLHUP):
            self.forget_unread()
            self._owner.drop(self)
            return
        if mask & select.EPOLLOUT:
            self.flush()
        if mask & _LISTEN and not self._half_closed:
            if self._owner.take_turn(self):
                self._noticed_s = time.monotonic()
            else:  # reported twice: it is heard again in its turn
                self.hear(False)

    @property
    def has_more(self) -> bool:
        """True if something is to be served, or read, in another turn."""
        return self.line is not None or self._unread > 0

    def prepare(self) -> bytes | None:
        """Read if that is due; return `line` if it is to be served now.

        A set-point is not served while a newer one of this connection may have come.
        """
        if self.line is None:
            if not self._half_closed:
                self._receive()
            self.advance()
        elif self._may_be_overtaken(self.line):
            self._read_beyond(self.line, self.received_s)
        for _ in range(_OVERTAKEN_AT_ONCE):
            line = self.line
            if line is None:
                return None
            if self._begin >= self._newest or not is_set_point(line):
                return None if self._unread and self._may_be_overtaken(line) else line
            self.advance()
        return None

    def hear(self, hears: bool) -> None:
        """Start or stop watching for more to read."""
        if hears != self.is_heard:
            self.is_heard = hears
            self._watch()

    def advance(self) -> None:
        """Advance to the next line of the received bytes; blank lines do not count."""
        if self._taken == len(self._received) and not self._half_closed:
            self.line, self._received, self._begin, self._taken, self._newest = None, b"", 0, 0, -1
            return
        begin = self._taken
        if not self._received.startswith(b"{", begin):
            text = _NOT_BLANK.search(self._received, begin)
            begin = len(self._received) if text is None else text.start()
        end = self._received.find(b"\n", begin)
        if end < 0 and self._half_closed and begin < len(self._received):
            end = len(self._received)
        self.line = None if end < 0 else self._received[begin:end]
        if end < 0:
            self._received, self._begin, self._taken, self._newest = (
                self._received[begin:],
                0,
                0,
                -1,
            )
        else:
            self._begin, self._taken, self.received_s = begin, end + 1, self._came_s
        if len(self.line or self._received) > MAX_LINE_BYTES:
            self._refuse(_TOO_LONG, bytes(self._unsent) + b"".join(self.session.outgoing))
        elif self._half_closed:
            self._drop_if_done()

    def note_stop(self, stopped_s: float) -> None:
        """Count the bytes unread in the kernel as received before a stop of `stopped_s`.

        Bytes behind those known to be there count as equally old.
        """
        before_s = math.nextafter(stopped_s, -math.inf)
        self._note_unread(self._unread_s if self._unread else before_s)

    def forget_unread(self) -> None:
        """Drop all whole lines that the client has sent until now, but serve the stops among them.

        For a lost client: its other requests no longer count.
        """
        if self.line is not None:
            self._received = self._received[self._begin :]
        elif self._taken:
            self._received = self._received[self._taken :]
        for _ in range(_LAST_READS):
            try:
                chunk = self._socket.recv(_LAST_BYTES)
            except OSError:  # there is no more, or the client is gone
                break
            if not chunk:
                self._half_closed = True
                break
            self._received += chunk
        whole, self._received = self._received, b""
        if not self._half_closed:  # a forked child may end the last line
            whole, _, self._received = whole.rpartition(b"\n")
        self.line, self._begin, self._taken, self._newest, self._unread = None, 0, 0, -1, 0
        self._watch()  # the end of the input would be reported for ever
        for line in stops_in(whole):
            self._owner.serve_last(self, line)
        self._drop_if_done()

    def flush(self) -> None:
        """Send as much as the client takes now; close a client with too long a backlog."""
        session, unsent, was_congested = self.session, self._unsent, self.session.congested
        outgoing = session.outgoing
        try:
            if len(outgoing) == 1 and not unsent:
                line = outgoing.pop()
                sent = self._send(line)
                if sent < len(line):  # without a copy if the kernel takes it whole
                    unsent += line[sent:]
            elif outgoing or unsent:
                unsent += b"".join(outgoing)
                outgoing.clear()
                sent = self._send(unsent)
                del unsent[:sent]
        except OSError:
            self._owner.drop(self)  # the client is gone
            return
        session.congested = bool(unsent)
        if len(self._unsent) > MAX_UNSENT_BYTES:
            cut_off = 0 if self._sent_whole else self._unsent.find(b"\n") + 1
            self._refuse(_BACKLOG_FULL, bytes(self._unsent[:cut_off]))
            return
        if session.congested != was_congested:
            self._watch()
        if self._half_closed:
            self._drop_if_done()

    def _send(self, waiting: bytes | bytearray) -> int:
        """Send as much as is taken now; raises `OSError` if the client is gone."""
        try:
            sent = self._socket.send(waiting)
        except BlockingIOError:
            return 0
        self._sent_whole = waiting[sent - 1] == _NEWLINE
        self.session.counters.bytes_out += sent
        return sent

    def close(self) -> None:
        """Close the socket; unsent lines are lost."""
        self._reactor.remove(self._socket.fileno())
        self._socket.close()

    def _may_be_overtaken(self, line: bytes) -> bool:
        """Return True if `line` is a set-point, the last one read, and more is to be read."""
        is_last = self._unread > 0 and self._received.find(b"\n", self._taken) < 0
        has_room = len(self._received) - self._begin <= MAX_LINE_BYTES
        return is_last and has_room and is_set_point(line)

    def _read_beyond(self, line: bytes, received_s: float) -> None:
        """Read the bytes after a set-point; it stays as old as it was."""
        self._received = self._received[self._begin :]
        self._taken = 0
        if not self._half_closed:
            self._receive()
        self.advance()
        if self.line == line:
            self.received_s = received_s

    def _receive(self) -> None:
        known, most = self._unread, MAX_LINE_BYTES + 1
        if 0 < known < most:
            most = known
        try:
            received = self._socket.recv(most)
        except BlockingIOError:
            self._unread = 0
            return
        except OSError:
            received = b""
        now_s = time.monotonic()
        self.waits_since_s = now_s if self._noticed_s is None else self._noticed_s
        self._noticed_s = None
        if known:
            self._came_s = self._unread_s
            self._unread = max(known - len(received), 0) if received else 0
        else:
            self._came_s = now_s
            if len(received) == most:
                self._note_unread(now_s)
        self.session.counters.bytes_in += len(received)
        if not received:
            self._half_closed = True
            self._watch()
        self._received += received
        self._newest = newest_set_point(self._received, self._taken)

    def _note_unread(self, by_s: float) -> None:
        """Record that all bytes unread in the kernel have arrived by a time."""
        answer = fcntl.ioctl(self._socket.fileno(), termios.FIONREAD, bytes(_INT.size))
        (self._unread,) = _INT.unpack(answer)
        self._unread_s = by_s

    def _drop_if_done(self) -> None:
        """Close a half-closed connection once nothing is left to do or to send."""
        waits = self.line is not None or self.session.outgoing or self._unsent
        if self._half_closed and not waits and self._owner.is_idle(self):
            self._owner.drop(self)

    def _refuse(self, refusal: Refusal, before: bytes) -> None:
        """Send the reason in a last line after `before`, and close."""
        peer = self.session.peer
        _log.warning("closing %s (pid %d): %s", peer.program, peer.pid, refusal.message)
        self._say_last(refusal, before)

    def part(self, refusal: Refusal) -> None:
        """Send the reason in a last line, and close: nothing is wrong with the client."""
        self._say_last(refusal, bytes(self._unsent) + b"".join(self.session.outgoing))

    def _say_last(self, refusal: Refusal, before: bytes) -> None:
        self.line = None
        try:
            # Make room for the reason where a client that does not read has left none.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * MAX_UNSENT_BYTES)
            self._socket.send(before + error_line(None, refusal))
        except OSError as error:
            _log.debug("the reason could not be sent: %s", error)
        self._owner.drop(self)

    def _watch(self) -> None:
        mask = _LISTEN if self.is_heard and not self._half_closed else 0
        if self.session.congested:
            mask |= select.EPOLLOUT
        self._reactor.modify(self._socket.fileno(), mask)
