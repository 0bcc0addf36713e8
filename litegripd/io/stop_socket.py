"""The stop socket: every line sent to it is a stop, in any form; nothing else is done here.

It is served before everything else in every tick, so no flood on the other socket can delay it. Its
lines are read leniently: a client that misspells a stop still gets the jaws stopped.
"""

import logging
import resource
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

from litegripd.io.loop import Urgent
from litegripd.io.sockets import LISTEN_BACKLOG, peer_of
from litegripd.model.errors import Refusal
from litegripd.model.state import Owner, StopLevel
from litegripd.rpc.jsonrpc import encode, error_line, result_line, stop_in
from litegripd.rpc.sessions import Peer, remote_name

_log = logging.getLogger(__name__)

MAX_STOP_CONNECTIONS = 64
MAX_STOP_LINE_BYTES = 1024


class Latched(NamedTuple):
    """A stop in force: its level, its generation, and how the motor is, as in the state."""

    level: StopLevel
    generation: int
    motor: str


OnStop: TypeAlias = Callable[[StopLevel, Owner, str | None], Latched]
"""Stops by a level, an owner and a reason; returns the stop in force then."""

_GIVES_WAY = Refusal(
    "too_many_connections",
    f"{MAX_STOP_CONNECTIONS} connections are open to the stop socket, and this one was idle the"
    " longest: connect again to stop",
    {"limit": MAX_STOP_CONNECTIONS},
)


class StopListener:
    """Accepts every client of a bound socket, and stops the gripper for it.

    With too many connections, the one that has been idle the longest is closed: a new client, which
    may have come to stop, is never rejected. Those that `is_gateway` names are believed on whose
    behalf they stop.
    """

    def __init__(
        self,
        urgent: Urgent,
        listener: socket.socket,
        on_stop: OnStop,
        is_gateway: Callable[[Peer], bool] = lambda _peer: False,
    ) -> None:
        self._urgent = urgent
        self._listener = listener
        self._on_stop = on_stop
        self._is_gateway = is_gateway
        self._connections: dict[StopConnection, None] = {}  # the longest idle first
        listener.setblocking(False)
        listener.listen(LISTEN_BACKLOG)
        urgent.add(listener.fileno(), self)

    @property
    def connections(self) -> int:
        """How many connections are open."""
        return len(self._connections)

    def on_event(self, _mask: int) -> None:
        """Accept one, and read at once what it has sent already."""
        try:
            accepted, _address = self._listener.accept()
        except BlockingIOError:
            return
        except OSError as error:  # gone already, or no descriptors left
            _log.debug("a connection to the stop socket could not be let in: %s", error)
            self._make_room()
            return
        if len(self._connections) >= MAX_STOP_CONNECTIONS:
            self._make_room()
        connection = StopConnection(accepted, self, self._is_gateway)
        self._connections[connection] = None
        try:
            self._urgent.add(accepted.fileno(), connection)
        except OSError as error:  # the user's epoll watches are used up
            _log.error("a connection to the stop socket is read only once: %s", error)
            connection.give_way()
        else:
            connection.on_event(0)

    def stop(self, level: StopLevel, by: Owner, why: str | None) -> Latched:
        """Stop; return the stop in force then."""
        return self._on_stop(level, by, why)

    def let_in_no_more(self) -> None:
        """Leave new clients from now on to a successor."""
        self._urgent.remove(self._listener.fileno())

    def touch(self, connection: "StopConnection") -> None:
        """Record that a connection has sent something."""
        del self._connections[connection]
        self._connections[connection] = None

    def forget(self, connection: "StopConnection") -> None:
        """Record that a connection is about to be closed."""
        self._urgent.remove(connection.fileno())
        del self._connections[connection]

    def close(self) -> None:
        """Close the socket and every connection."""
        self._urgent.remove(self._listener.fileno())
        self._listener.close()
        for connection in list(self._connections):
            connection.close()

    def _make_room(self) -> None:
        longest_idle = next(iter(self._connections), None)
        if longest_idle is not None:
            longest_idle.give_way()


class StopConnection:
    """A client at the stop socket; every line is answered, and no answer is waited for.

    One line is taken at a time, the others wait in the kernel. A last line without its newline
    counts as a line, and so does one that is too long.
    """

    def __init__(
        self,
        connected: socket.socket,
        listener: StopListener,
        is_gateway: Callable[[Peer], bool],
    ) -> None:
        connected.setblocking(False)
        peer = peer_of(connected)
        self._may_be_another = is_gateway(peer)
        self._owner = Owner(0, peer.pid, peer.uid, peer.program)  # it has no session's number
        self._socket = connected
        self._listener = listener
        self._line = b""

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def on_event(self, _mask: int) -> None:
        """Read up to the end of a line, or of the input; stop if that was a line."""
        taken = self._receive()
        if taken is None:
            return
        self._listener.touch(self)
        self._line += taken
        is_whole = self._line.endswith(b"\n")
        is_over = not taken or (not is_whole and len(self._line) >= MAX_STOP_LINE_BYTES)
        try:
            if is_whole or (is_over and self._line):
                self._stop()
        finally:
            if is_over:
                self.close()

    def give_way(self) -> None:
        """Close; what has been sent until now is still a stop."""
        self._line += self._receive() or b""
        try:
            if self._line:
                self._stop()
            else:
                self._send(error_line(None, _GIVES_WAY))
        finally:
            self.close()

    def close(self) -> None:
        """Close the socket."""
        self._listener.forget(self)
        self._socket.close()

    def _receive(self) -> bytes | None:
        """Return the line's bytes so far; empty at the end, None if nothing has come."""
        try:
            waiting = self._socket.recv(MAX_STOP_LINE_BYTES - len(self._line), socket.MSG_PEEK)
            return self._socket.recv(waiting.find(b"\n") + 1 or len(waiting))
        except BlockingIOError:
            return None
        except OSError:  # reset: gone, whatever it has sent before
            return b""

    def _stop(self) -> None:
        line, self._line = self._line, b""
        stop, owner = stop_in(line), self._owner
        if stop.on_behalf is not None and self._may_be_another:
            name = remote_name(stop.on_behalf)
            owner = replace(owner, program=name, remote=stop.on_behalf)
        latched = self._listener.stop(stop.level, owner, stop.why)
        self._send(result_line(stop.identity, encode(latched._asdict())))

    def _send(self, line: bytes) -> None:
        try:
            self._socket.send(line)
        except OSError as error:
            _log.debug("%s takes no answer to its stop: %s", self._owner.program, error)


OWN = 64  # for sockets, files, timers, links and child processes
PER_CLIENT = 2  # its connection, and the watch on its process
LEAST_CLIENTS = 16


class TooFewDescriptorsError(OSError):
    """The process may not open enough files; the message says how many it needs."""


def clients_within_limit(wanted: int) -> int:
    """Raise the limit of open files if needed and allowed; return how many clients fit.

    Returns at most `wanted`. Raises `TooFewDescriptorsError` if there is hardly room for any.
    """
    reserved = OWN + MAX_STOP_CONNECTIONS
    enough = reserved + PER_CLIENT * wanted
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = _larger(soft, _smaller(hard, enough))
    if limit != soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))
    clients = (_smaller(limit, enough) - reserved) // PER_CLIENT
    if clients < LEAST_CLIENTS:
        raise TooFewDescriptorsError(
            f"this process may open {hard} files, and needs {reserved + PER_CLIENT * LEAST_CLIENTS}"
            f" at least ({enough} for {wanted} clients), some of them for stops: raise the limit"
            " (LimitNOFILE= of the unit, or ulimit -n)"
        )
    return clients


def _larger(one: int, other: int) -> int:
    return resource.RLIM_INFINITY if resource.RLIM_INFINITY in (one, other) else max(one, other)


def _smaller(one: int, other: int) -> int:
    finite = [limit for limit in (one, other) if limit != resource.RLIM_INFINITY]
    return min(finite)
