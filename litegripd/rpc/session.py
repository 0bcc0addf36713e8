"""One client's side of the protocol, without its socket: who it is and what it is to be sent."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from litegripd.rpc.counters import Counters

Role: TypeAlias = Literal["observer", "operator", "admin"]
ROLES: tuple[Role, ...] = ("observer", "operator", "admin")


@dataclass(frozen=True, slots=True)
class Peer:
    """Who is at the other end of a connection, as the kernel tells it; `groups` as gids."""

    pid: int
    uid: int
    gid: int
    program: str
    groups: tuple[int, ...] = ()


class Session:
    """What is kept of one connection while it lasts.

    `write` queues a line to be sent, and tells `on_write` when it is the first. `congested` is
    kept by the transport: true while the client has not read all it was sent, so that samples
    are dropped for it rather than queued. `unanswered` counts the requests that wait for a motion,
    `subscriptions` what it is sent unasked. `stream_refused` is the reason why its latest set-point
    was refused. `is_orphaned`: the process that opened it has ended, or the connection.
    """

    __slots__ = (
        "congested",
        "counters",
        "identity",
        "is_orphaned",
        "name",
        "on_write",
        "opened_s",
        "outgoing",
        "peer",
        "role",
        "stream_refused",
        "subscriptions",
        "unanswered",
    )

    def __init__(self, identity: int, peer: Peer, opened_s: float = 0.0) -> None:
        self.identity = identity
        self.peer = peer
        self.opened_s = opened_s
        self.role: Role = "admin"
        self.counters = Counters()
        self.subscriptions = 0
        self.name = peer.program
        self.outgoing: list[bytes] = []
        self.congested = False
        self.unanswered = 0
        self.stream_refused: str | None = None
        self.is_orphaned = False
        self.on_write: Callable[[], None] | None = None

    def write(self, line: bytes) -> None:
        """Queue `line`, which ends in a newline, for sending."""
        if not self.outgoing and self.on_write is not None:
            self.on_write()
        self.outgoing.append(line)


class Service(Protocol):
    """What the transport passes lines to; nothing of it raises."""

    def opened(self, peer: Peer, now_s: float) -> Session:
        """Begin a session for a new connection."""

    def handle(
        self, session: Session, line: bytes, now_s: float, received_s: float | None = None
    ) -> None:
        """Take one request line, without its newline; `received_s`: when it came, if not now."""

    @property
    def pending(self) -> bool:
        """Whether events or samples wait to be sent."""

    def send_one(self) -> None:
        """Write to one session what waits for one of its subscriptions."""

    def closed(self, session: Session, now_s: float) -> None:
        """End a session; what its connection owned is lost with it."""

    def process_ended(self, session: Session, now_s: float) -> None:
        """Take note that the process is gone which opened the session's connection."""

    def is_idle(self, session: Session) -> bool:
        """Whether nothing will be sent to `session` that it has not asked for anew."""
