"""The clients' side without their sockets: who each is, what it gets, and what it costs."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from litegripd.model.calibration import Calibration, ScaleDoubt
from litegripd.model.errors import Refusal
from litegripd.model.sentence import Sentence, joined, sentence
from litegripd.model.state import Owner
from litegripd.rpc.jsonrpc import encode


@dataclass(slots=True, eq=False)
class Counters:
    """One client's figures since it connected.

    `requests` counts the lines that were served, `refused` those that were rejected, `dropped` the
    samples of its subscriptions that it did not get. `worst_latency_s` is the longest time from a
    line's arrival to its answer being queued, for requests that wait for no motion; None before the
    first.
    """

    requests: int = 0
    refused: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    dropped: int = 0
    worst_latency_s: float | None = None

    def note_latency(self, latency_s: float) -> None:
        """Keep the worst latency."""
        if self.worst_latency_s is None or latency_s > self.worst_latency_s:
            self.worst_latency_s = latency_s


Role: TypeAlias = Literal["observer", "operator", "admin"]
ROLES: tuple[Role, ...] = ("observer", "operator", "admin")

_MAY: Mapping[Role, str] = {
    "observer": "read and stop",
    "operator": "read, stop and move",
    "admin": "do all",
}


@dataclass(frozen=True, slots=True)
class Peer:
    """The process at the other end of a connection, as the kernel gives it; `groups` as gids."""

    pid: int
    uid: int
    gid: int
    program: str
    groups: tuple[int, ...] = ()


def remote_name(remote: str, name: str | None = None) -> str:
    """Return how a remote user's program is called; without a `name`, the user."""
    return f"{remote} via gateway" if name is None else f"{name} of {remote} via gateway"


class Session:
    """The data of one connection while it lasts.

    `write` queues a line to be sent, and calls `on_write` for the first one. `congested` is kept by
    the transport: true while the client has not read all it was sent, so that its samples are
    dropped instead of queued. `unanswered` counts the requests that wait for a motion,
    `subscriptions` what it gets unrequested. `turned_down` has, by method, why the latest request
    without an id was rejected. `is_orphaned`: the process that opened it has ended, or the
    connection. `is_gateway`: it may speak for users of other machines, `remote` is for whom it
    does. `calibration` is the latest that one of its requests has brought, `doubts` why such were
    probably wrong, as far as that was told.
    """

    __slots__ = (
        "calibration",
        "congested",
        "counters",
        "doubts",
        "identity",
        "is_gateway",
        "is_orphaned",
        "name",
        "on_write",
        "opened_s",
        "outgoing",
        "owner",
        "peer",
        "remote",
        "role",
        "subscriptions",
        "turned_down",
        "unanswered",
    )

    def __init__(self, identity: int, peer: Peer, opened_s: float = 0.0) -> None:
        self.identity = identity
        self.peer = peer
        self.opened_s = opened_s
        self.role: Role = "observer"
        self.is_gateway = False
        self.remote: str | None = None
        self.counters = Counters()
        self.subscriptions = 0
        self.rename(peer.program)
        self.outgoing: list[bytes] = []
        self.congested = False
        self.unanswered = 0
        self.turned_down: dict[str, str] = {}
        self.calibration: Calibration | None = None
        self.doubts: set[ScaleDoubt] = set()
        self.is_orphaned = False
        self.on_write: Callable[[], None] | None = None

    def rename(self, name: str) -> None:
        """Set the client's name; `owner` has it as jobs and stops name it."""
        self.name = name
        peer = self.peer
        self.owner = Owner(self.identity, peer.pid, peer.uid, name, remote=self.remote)

    def speak_for(self, remote: str, role: Role, name: str | None) -> None:
        """Be the connection of a user of another machine, with a role of its own."""
        self.remote, self.role = remote, role
        self.rename(remote_name(remote, name))

    def write(self, line: bytes) -> None:
        """Queue `line`, which ends in a newline, for sending."""
        if not self.outgoing and self.on_write is not None:
            self.on_write()
        self.outgoing.append(line)


def not_permitted(session: Session, needs: Role, what: Sentence | str) -> Refusal:
    """Return why a client may not do `what` with its role, and who opens it.

    Clients on this machine put the user's name in place of `uid`: looking for it may take long.
    """
    user, role, remote = session.owner.user, session.role, session.remote
    text = sentence(
        ": {user} is an {role}, who may {may}; this needs an {needs}",
        user=remote or str(user),
        role=role,
        may=_MAY[role],
        needs=needs,
    )
    data: dict[str, object] = {"needs": needs, "role": role}
    if remote is None:
        data["uid"] = user.uid
        data["hint"] = sentence(
            "an admin adds {user} to {needs}s in [access] of the daemon's configuration, then"
            " restarts the daemon",
            user=str(user),
            needs=needs,
        )
    else:
        data["hint"] = (
            f"the role of {remote} is said by [portal] where {remote} works and by [router.users]"
            " at the router; that of the gateway's user, in [access] of the daemon's"
            " configuration, bounds it"
        )
    return Refusal("not_permitted", joined("", [what, text]), data)


class Service(Protocol):
    """Takes lines from the transport; none of its methods raises."""

    def opened(self, peer: Peer, now_s: float) -> Session:
        """Begin a session for a new connection."""

    def handle(
        self, session: Session, line: bytes, now_s: float, received_s: float | None = None
    ) -> None:
        """Take one request line, without its newline; `received_s`: when it came, if not now."""

    @property
    def pending(self) -> bool:
        """True if events or samples wait to be sent."""

    def send_one(self) -> None:
        """Write to one session what waits for one of its subscriptions."""

    def closed(self, session: Session, now_s: float) -> None:
        """End a session; what its connection owned is lost with it."""

    def process_ended(self, session: Session, now_s: float) -> None:
        """Record that the process is gone which opened the session's connection."""

    def is_idle(self, session: Session) -> bool:
        """Return True if the session has no pending answers and no subscriptions."""


class Clients:
    """The open sessions, in the order in which they were opened."""

    def __init__(self) -> None:
        self._sessions: dict[int, Session] = {}

    def __iter__(self) -> Iterator[Session]:
        """Iterate over the sessions."""
        return iter(self._sessions.values())

    def get(self, identity: object) -> Session | None:
        """Return the open session of this number."""
        return self._sessions.get(identity) if isinstance(identity, int) else None

    def add(self, session: Session) -> None:
        """Add a session that begins."""
        self._sessions[session.identity] = session

    def remove(self, session: Session) -> None:
        """Remove a session that has ended."""
        self._sessions.pop(session.identity, None)

    def listing(self, me: Session, now_s: float) -> bytes:
        """Return the list as `me` sees it, as JSON.

        There may be 256 of them, and one answer must not hold up a tick: each is formatted, which
        takes 0.35 ms for all, less than half the time for encoding dicts.
        """
        return b'{"clients":[%b]}' % b",".join(_row(session, me, now_s) for session in self)


def _row(session: Session, me: Session, now_s: float) -> bytes:
    counters, peer = session.counters, session.peer
    worst_s = counters.worst_latency_s
    return (
        b'{"client":%d,"pid":%d,"uid":%d,"program":%b,"role":%b,"connected_s":%.3f,'
        b'"requests":%d,"refused":%d,"bytes_in":%d,"bytes_out":%d,"dropped":%d,'
        b'"worst_latency_ms":%b,"subscriptions":%d,"waiting":%d,"is_me":%b}'
    ) % (
        session.identity,
        peer.pid,
        peer.uid,
        encode(session.name),
        encode(session.role),
        now_s - session.opened_s,
        counters.requests,
        counters.refused,
        counters.bytes_in,
        counters.bytes_out,
        counters.dropped,
        b"null" if worst_s is None else b"%.3f" % (worst_s * 1e3),
        session.subscriptions,
        session.unanswered,
        b"true" if session is me else b"false",
    )
