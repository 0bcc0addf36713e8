"""A session as its gateway has it: a user's lines in, the daemon's lines out. It knows no clock."""

from collections.abc import Callable, Collection
from typing import Any

from litegrip_fleet.far.admission import (
    LONGEST_TTL_S,
    SHORTEST_TTL_S,
    RefusedError,
    asked_lease,
    may_ask_lease,
    passed,
)
from litegrip_fleet.wire.daemon_lines import is_sample
from litegrip_fleet.wire.messages import Ask, Push, Reply
from litegrip_fleet.wire.rows import Inbox, Outbox

PIECE_BYTES = 32_768
"""Of a longer line of the daemon's: no message on the network is longer."""

ROOM_BYTES = 262_144
"""While more is unconfirmed, the daemon is not read: it drops samples then, as for any client."""

MOST_UNCONFIRMED_BYTES = 1024 * 1024
"""While more is, no line is taken: a refusal of each would be kept here, too."""

AGAIN_BYTES = 65_536
"""At most this is sent again at once."""

LATE_SHARE = 0.75
"""Of a session's time to live: a sign of life that is later shows that too much is sent."""

DEFAULT_TTL_S = 1.0
MOST_ASKED_LEASES = 16
"""So many requests for a lease wait for their answers at once, with effect on its renewal."""


class FarSession:
    """One remote client's session, in virtual or real time.

    `to_daemon` takes a line for the daemon, or None at the end of them, `push` a message and its
    payload for the portal. `voided` are the daemon's methods that a stop makes void.
    """

    def __init__(
        self,
        opening: Ask,
        now_s: float,
        *,
        session: str,
        voided: Collection[str],
        to_daemon: Callable[[bytes | None], None],
        push: Callable[[Push, bytes], None],
    ) -> None:
        self.generation: int | None = None
        self.sheds = False
        """True while the portal's life is late: no samples are sent, which leaves room for it."""

        self.may_lease = False
        """True once the client may have asked for a lease: without one there is none to renew."""

        self.renews = True
        """False while the client has a lease with a time to live of its own: then only what it
        sends itself shows that it lives, and not its portal."""

        self.ttl_s = min(max(opening.ttl_s or DEFAULT_TTL_S, SHORTEST_TTL_S), LONGEST_TTL_S)
        self._asked_leases: dict[bytes, bool] = {}
        """By how the answer begins: whether a time to live was named."""

        self._process = opening.process or session
        self._voided = voided
        self._to_daemon = to_daemon
        self._push = push
        self._heard_s = now_s
        self._inbox = Inbox()
        self._outbox: Outbox[tuple[Push, bytes]] = Outbox()

    @property
    def has_room(self) -> bool:
        """False while the portal is behind: then the daemon is not to be read."""
        return self._outbox.size_bytes < ROOM_BYTES

    def is_lost(self, now_s: float) -> bool:
        """Return True once the portal has shown no life for the session's time to live."""
        return now_s - self._heard_s > self.ttl_s

    def is_late(self, now_s: float) -> bool:
        """Return True while the portal has shown no life for most of the time to live."""
        return now_s - self._heard_s > LATE_SHARE * self.ttl_s

    def asked(self, ask: Ask, line: bytes, now_s: float) -> None:
        """Take a message of the portal's: a line, or that its client lives.

        A network may have kept it: life counts from when it was shown, not from when that came.
        """
        shown_s = now_s if ask.at_s is None else min(ask.at_s, now_s)
        self._heard_s = max(self._heard_s, shown_s)
        self._outbox.confirm(ask.got)
        if ask.again:
            self._push_again()
        is_heard = self._outbox.size_bytes < MOST_UNCONFIRMED_BYTES
        if ask.op == "line" and is_heard and self._inbox.take(ask.number):
            self._take(ask, line, now_s)
        if ask.op == "eof" and self._inbox.take(ask.number):
            self._to_daemon(None)

    def reply(self, now_s: float, about: dict[str, Any] | None = None) -> Reply:
        """Return what a query is answered with."""
        return Reply(self._inbox.taken, self._outbox.last, now_s, self.generation, None, about)

    def said(self, line: bytes) -> None:
        """Send a line of the daemon's, with its newline, to the portal."""
        for answer in [begin for begin in self._asked_leases if line.startswith(begin)]:
            is_own = self._asked_leases.pop(answer)
            if line.startswith(b'"result"', len(answer)):
                self.renews = not is_own
        if is_sample(line) and len(line) <= PIECE_BYTES:
            if self.sheds:
                return
            self._push(Push(None, generation=self.generation), line)
            return
        for begin in range(0, len(line), PIECE_BYTES):
            piece = line[begin : begin + PIECE_BYTES]
            self._send(piece, more=begin + PIECE_BYTES < len(line))

    def ended(self) -> None:
        """Say, behind all else, that the daemon has closed the connection."""
        self._send(b"", end=True)

    def _take(self, ask: Ask, line: bytes, now_s: float) -> None:
        try:
            request = passed(
                line,
                now_s,
                at_s=ask.at_s,
                generation=ask.generation,
                ttl_s=self.ttl_s,
                voided=self._voided,
                process=self._process,
            )
        except RefusedError as refused:
            if refused.answer:
                self.said(refused.answer)
            return
        self.may_lease = self.may_lease or may_ask_lease(line)
        if (lease := asked_lease(line)) is not None and len(self._asked_leases) < MOST_ASKED_LEASES:
            self._asked_leases |= [lease]
        self._to_daemon(request)

    def _send(self, piece: bytes, *, more: bool = False, end: bool = False) -> None:
        number = self._outbox.last + 1
        push = Push(number, more, end, self.generation)
        self._outbox.add((push, piece), len(piece))
        self._push(push, piece)

    def _push_again(self) -> None:
        size_bytes = 0
        for _number, (push, piece) in self._outbox.unconfirmed():
            self._push(push, piece)
            size_bytes += len(piece)
            if size_bytes > AGAIN_BYTES:
                return
