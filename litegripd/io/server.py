"""The Unix socket at which clients speak JSON-RPC: bytes in and out, fairly, without waiting.

It knows lines and bounds, not methods: every line goes to the `Service`. Users take turns by the
time they have used, then each user's connections: a user with 64 connections is served as much as a
user with one. A turn is for one line. A connection whose lines still wait is not read further, so a
flood waits in the kernel; only a newer set-point overtakes older ones.
"""

import logging
import select
import socket
import time
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from litegripd.io.connection import Connection
from litegripd.io.loop import ProcessWatch, Reactor
from litegripd.io.sockets import LISTEN_BACKLOG, peer_of
from litegripd.model.errors import Refusal
from litegripd.model.state import Owner
from litegripd.rpc.jsonrpc import error_line
from litegripd.rpc.sessions import Peer, Service

if TYPE_CHECKING:
    from litegripd.io.connection import Connection

LIGHT_SHARE = 0.1
"""Of a period: a user who has used less recently is light, and is served although a flood has used
up the time for requests."""

_FADES = 0.5  # the used time counts half after each period
_FORGOTTEN = 1e-3  # of a period


@dataclass(slots=True, eq=False)
class _User:
    """One user's waiting connections, the next one first, and the seconds used recently."""

    used_s: float = 0.0
    waiting: "dict[Connection, None]" = field(default_factory=dict)


class Turns:
    """The connections that have something to be read or served.

    `charge` the time that a user costs; `next_period` lets the past fade.
    """

    def __init__(self, period_s: float) -> None:
        self._light_s = LIGHT_SHARE * period_s
        self._forgotten_s = _FORGOTTEN * period_s
        self._users: defaultdict[int, _User] = defaultdict(_User)
        self.waiting: dict[int, _User] = {}
        """The users with a waiting connection, by uid."""

    @property
    def has_light(self) -> bool:
        """True if a connection of a light user waits."""
        return any(user.used_s < self._light_s for user in self.waiting.values())

    def add(self, connection: "Connection") -> bool:
        """Queue a connection behind the same user's others; False if it waits already."""
        uid = connection.session.peer.uid
        user = self._users[uid]
        if connection in user.waiting:
            return False
        user.waiting[connection] = None
        self.waiting[uid] = user
        return True

    def remove(self, connection: "Connection") -> bool:
        """Remove a connection from the queue; False if it was not in it."""
        uid = connection.session.peer.uid
        user = self.waiting.get(uid)
        if user is None or connection not in user.waiting:
            return False
        del user.waiting[connection]
        if not user.waiting:
            del self.waiting[uid]
        return True

    def heads(self, *, light_only: bool) -> "list[Connection]":
        """Return each user's next connection, the user who has used the least first."""
        users = list(self.waiting.values())
        if light_only:
            users = [user for user in users if user.used_s < self._light_s]
        if len(users) > 1:
            users.sort(key=lambda user: user.used_s)
        return [next(iter(user.waiting)) for user in users]

    def charge(self, uid: int, used_s: float) -> None:
        """Charge a user for some time."""
        self._users[uid].used_s += used_s

    def next_period(self, periods: int) -> None:
        """Let the used time fade, once for each period that has begun."""
        fades = _FADES**periods
        for uid, user in list(self._users.items()):
            user.used_s *= fades
            if user.used_s < self._forgotten_s and not user.waiting:
                del self._users[uid]


_log = logging.getLogger(__name__)

MAX_CONNECTIONS = 256
MAX_CONNECTIONS_PER_UID = 64

_NOBODY = -1  # as a user: samples are charged to nobody
_STEPS_AT_ONCE = 4  # lines, samples and flushes
_COST_PER_LINE_S = 60e-6
_COST_PER_BYTE_S = 65e-9  # parsing 64 KiB takes about 4 ms
_COST_SHARE_AT_MOST = 0.4  # of a period; less than the share of all requests


class Server:
    """Accepts clients on a bound socket and passes their lines to `service`.

    `room` is the number of clients for which there are descriptors, if less than `MAX_CONNECTIONS`.
    """

    def __init__(
        self,
        reactor: Reactor,
        listener: socket.socket,
        service: Service,
        room: int = MAX_CONNECTIONS,
    ) -> None:
        self.requests = 0
        self._room = room
        self.refused_connections = 0
        self._reactor = reactor
        self._listener = listener
        self._service = service
        self._connections: dict[int, Connection] = {}
        self._per_uid: Counter[int] = Counter()
        self._watches: dict[int, ProcessWatch] = {}
        self._turns = Turns(reactor.period_s)
        self._ticks = reactor.ticks
        self._dirty: deque[Connection] = deque()
        self._samples_turn = False
        self._stopped_s: float | None = None  # some who wait to be accepted came before that stop
        listener.setblocking(False)
        listener.listen(LISTEN_BACKLOG)
        reactor.add(listener.fileno(), self)

    @property
    def clients(self) -> int:
        """How many clients are connected."""
        return len(self._connections)

    @property
    def pending(self) -> bool:
        """True if a line waits to be served, or anything to be sent."""
        return bool(self._turns.waiting or self._dirty) or self._service.pending

    @property
    def pending_light(self) -> bool:
        """True if a line or a sample waits for a user who has used little time recently."""
        return bool(self._dirty) or self._turns.has_light

    @property
    def is_open(self) -> bool:
        """True if new clients are accepted."""
        return self._reactor.serves(self._listener.fileno())

    @property
    def lines_wait(self) -> bool:
        """True if a client's line waits to be served."""
        return bool(self._turns.waiting)

    def serve(self, until_s: float, *, light_only: bool = False) -> None:
        """Send what waits and serve lines in turn, while there is time.

        Samples and lines take turns, so that neither can starve the other. A long line that would
        end in the next tick waits for the begin of a period. It returns after a few steps: the loop
        has to see who else has sent something, or a new client would wait until a flood has used up
        the whole share. With `light_only` only users are served who have used little time recently.
        """
        if self._ticks != self._reactor.ticks:
            self._turns.next_period(self._reactor.ticks - self._ticks)
            self._ticks = self._reactor.ticks
        now_s = time.monotonic()
        for _ in range(_STEPS_AT_ONCE):
            if now_s >= until_s:
                return
            uid = self._step(now_s, until_s, light_only)
            if uid is None:
                return
            began_s, now_s = now_s, time.monotonic()
            self._turns.charge(uid, now_s - began_s)
            if not self.pending:
                return

    def _step(self, now_s: float, until_s: float, light_only: bool) -> int | None:
        """Do the next step; return its user, or None if nothing can be done in time."""
        if self._dirty:
            connection = self._dirty.popleft()
            connection.flush()
            return connection.session.peer.uid
        is_samples_turn = self._samples_turn or not self._turns.waiting
        if is_samples_turn and not light_only and self._service.pending:
            self._samples_turn = False
            self._service.send_one()
            return _NOBODY
        for connection in self._turns.heads(light_only=light_only):
            if self._take_turn(connection, now_s, until_s):
                self._samples_turn = True
                return connection.session.peer.uid
        return None

    def _take_turn(self, connection: Connection, now_s: float, until_s: float) -> bool:
        """Read, and serve a line; return False, with nothing done, if that would take long."""
        line = connection.prepare()
        if line is not None and now_s + self._cost_s(line) > until_s:
            return False
        try:
            if line is not None:
                self._serve_line(connection, line, now_s)
        finally:
            if self._turns.remove(connection):  # otherwise it was dropped
                if connection.has_more:
                    self._turns.add(connection)
                elif not connection.is_heard:
                    connection.hear(True)
        return True

    def flush(self) -> None:
        """Send all waiting lines, as far as the clients take them."""
        while self._service.pending:
            self._service.send_one()
        while self._dirty:
            self._dirty.popleft().flush()

    def _serve_line(self, connection: Connection, line: bytes, now_s: float) -> None:
        self.requests += 1
        session = connection.session
        waiting = session.unanswered
        try:
            self._service.handle(session, line, now_s, connection.received_s)
            if session.unanswered <= waiting:
                session.counters.note_latency(time.monotonic() - connection.waits_since_s)
        finally:
            connection.advance()
        if self._dirty and self._dirty[-1] is connection:  # it is answered: no step of its own
            self._dirty.pop()
            connection.flush()

    def _cost_s(self, line: bytes) -> float:
        """Return the estimated time of a line; a fresh period has room for any."""
        cost_s = _COST_PER_LINE_S + _COST_PER_BYTE_S * len(line)
        return min(cost_s, _COST_SHARE_AT_MOST * self._reactor.period_s)

    def on_event(self, _mask: int) -> None:
        """Accept one new client; the next one is for the next event."""
        try:
            accepted, _address = self._listener.accept()
        except BlockingIOError:
            return
        except OSError:  # gone already, or out of descriptors or memory: another may succeed
            self.refused_connections += 1
            return
        self._admit(accepted)
        if self._stopped_s is not None and not self._somebody_waits():
            self._stopped_s = None

    def drop(self, connection: Connection) -> None:
        """Close a connection and notify the service."""
        if self._connections.pop(connection.session.identity, None) is None:
            return
        self._per_uid[connection.session.peer.uid] -= 1
        connection.line = None
        self._turns.remove(connection)
        if connection in self._dirty:
            self._dirty.remove(connection)
        connection.close()
        connection.session.on_write = None
        watch = self._watches.pop(connection.session.identity, None)
        if watch is not None:
            watch.close()
        self._service.closed(connection.session, time.monotonic())

    def let_in(self, allowed: bool) -> None:
        """Accept new clients, or let them wait in the kernel until this is called again."""
        self._reactor.modify(self._listener.fileno(), select.EPOLLIN if allowed else 0)

    def drain(self, until_s: float) -> None:
        """Read and serve all that every client has sent until now, while there is time."""
        for connection in list(self._connections.values()):
            connection.on_event(select.EPOLLIN)
        while self.pending and time.monotonic() < until_s:
            self.serve(until_s)

    def close(self, parting: Refusal | None = None) -> None:
        """Close the listening socket and every connection, of which `parting` is the last line."""
        self._reactor.remove(self._listener.fileno())
        self._listener.close()
        for connection in list(self._connections.values()):
            if parting is None:
                self.drop(connection)
            else:
                connection.part(parting)

    def note_stop(self, stopped_s: float) -> None:
        """Count all that clients have sent until now as received before a stop of `stopped_s`.

        Clients that wait to be accepted may have sent something, too. Their number is unknown: so
        until nobody waits, what a newly accepted client has sent by then counts as from before the
        stop.
        """
        for connection in self._connections.values():
            connection.note_stop(stopped_s)
        if self._somebody_waits():
            self._stopped_s = stopped_s

    def named(self, by: Owner) -> Owner:
        """Return a process with the name that it gives itself on its latest connection here."""
        for connection in reversed(self._connections.values()):
            owner = connection.session.owner
            if by.pid and (owner.pid, owner.uid) == (by.pid, by.uid) and owner.remote is None:
                return replace(by, program=owner.program)
        return by

    def take_turn(self, connection: Connection) -> bool:
        """Queue a connection for its turn to read and be served; False if it is queued already."""
        return self._turns.add(connection)

    def serve_last(self, connection: Connection, line: bytes) -> None:
        """Serve a line that a client has left behind."""
        self.requests += 1
        now_s = time.monotonic()
        self._service.handle(connection.session, line, now_s, now_s)

    def is_idle(self, connection: Connection) -> bool:
        """Return True if a client that sends nothing more has nothing more to receive."""
        return self._service.is_idle(connection.session)

    def _somebody_waits(self) -> bool:
        """Return True if a client waits in the kernel to be accepted."""
        listener = self._listener
        return listener.fileno() >= 0 and bool(select.select((listener,), (), (), 0)[0])

    def _admit(self, accepted: socket.socket) -> None:
        accepted.setblocking(False)
        peer = peer_of(accepted)
        refusal = self._refusal(peer)
        if refusal is not None:
            self.refused_connections += 1
            with accepted:
                try:
                    accepted.send(error_line(None, refusal))
                except OSError as error:
                    _log.debug("a refused client was gone already: %s", error)
            return
        session = self._service.opened(peer, time.monotonic())
        connection = Connection(self._reactor, accepted, session, self)
        session.on_write = lambda: self._dirty.append(connection)
        self._connections[session.identity] = connection
        self._per_uid[peer.uid] += 1
        try:
            self._reactor.add(accepted.fileno(), connection, select.EPOLLIN | select.EPOLLRDHUP)
        except OSError as error:  # the user's epoll watches are used up
            _log.error("a client cannot be served: %s", error)
            self.drop(connection)
            return
        if self._stopped_s is not None:
            connection.note_stop(self._stopped_s)
        self._watch_process(connection)

    def _watch_process(self, connection: Connection) -> None:
        session = connection.session

        def ended() -> None:
            self._watches.pop(session.identity, None)
            connection.forget_unread()
            self._service.process_ended(session, time.monotonic())

        try:
            watch = ProcessWatch(self._reactor, session.peer.pid, ended)
        except ProcessLookupError:  # it has ended since it connected: who has its socket now?
            ended()
        except OSError as error:  # then the end of its connection reports it
            _log.debug("process %d is not watched: %s", session.peer.pid, error)
        else:
            self._watches[session.identity] = watch

    def _refusal(self, peer: Peer) -> Refusal | None:
        most = min(MAX_CONNECTIONS, self._room)
        if len(self._connections) >= most:
            limit, whose = most, "in all"
        elif self._per_uid[peer.uid] >= MAX_CONNECTIONS_PER_UID:
            limit, whose = MAX_CONNECTIONS_PER_UID, f"for user {peer.uid}"
        else:
            return None
        return Refusal(
            "too_many_connections",
            f"{limit} connections are open {whose}, no more are let in: close one",
            {"limit": limit},
        )
