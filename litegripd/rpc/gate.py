"""What every request must pass before it is carried out: its parameters, role, lease, stops."""

from litegripd.control.admission import ENDING
from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Owner
from litegripd.rpc.jsonrpc import Request
from litegripd.rpc.method import Method
from litegripd.rpc.methods.lease import Tokens
from litegripd.rpc.reports import MAX_PER_SESSION
from litegripd.rpc.schema import check
from litegripd.rpc.sessions import ROLES, Session


class Gate:
    """Admits requests, or says why not."""

    def __init__(self, engine: Engine, tokens: Tokens) -> None:
        self._engine = engine
        self._tokens = tokens

    def admit(
        self,
        session: Session,
        request: Request,
        method: Method,
        now_s: float,
        received_s: float,
    ) -> Owner | Refusal:
        """Return on whose behalf a request is to be carried out, or why it is not."""
        self._engine.lease.renew(session.identity, now_s)
        refusal = _malformed(session, request, method)
        refusal = refusal or self._void(session, request, method, received_s)
        if refusal is not None:
            return refusal
        peer, token = session.peer, request.params.get("lease")
        grant = None if token is None else self._tokens.number(token)
        owner = Owner(session.identity, peer.pid, peer.uid, session.name, grant)
        return self._forbidden(session, method, owner) or owner

    def _void(
        self, session: Session, request: Request, method: Method, received_s: float
    ) -> Refusal | None:
        """Return a refusal if a request was sent, or received, before the latest stop."""
        if not method.stop_voids:
            return None
        params = request.params
        latch = self._engine.stop_latch
        return latch.refusal_of_sent(
            params.get("stop_generation"), params.get("sent_s"), received_s, session.identity
        )

    def _forbidden(self, session: Session, method: Method, owner: Owner) -> Refusal | None:
        """Say what the daemon's end, the sender's role or somebody's lease forbids."""
        if self._engine.is_ending and method.role != "observer":
            return ENDING  # whatever it changed would be lost; a stop and reads are for all
        if session.is_orphaned and method.role != "observer":
            return _orphaned(session)
        if method.lifts_stop and self._has_stopped(session):
            return None
        if ROLES.index(session.role) < ROLES.index(method.role):
            text = f"{method.name} needs the role {method.role}; uid {owner.uid} is {session.role}"
            return Refusal("not_permitted", text, {"needs": method.role, "role": session.role})
        refusal = self._engine.lease.refusal(owner) if method.needs_lease else None
        if refusal is not None and method.lifts_stop:
            is_admin = session.role == "admin"
            return None if is_admin else self._engine.stop_latch.clearing_refusal(refusal)
        return refusal

    def _has_stopped(self, session: Session) -> bool:
        latch, is_observer = self._engine.stop_latch, session.role == "observer"
        return latch.may_be_cleared_by(session.peer.uid, alone=is_observer)


def _orphaned(session: Session) -> Refusal:
    """Say that the process is gone that was let in: whoever has its connection now was not."""
    text = (
        f"the process that opened this connection (pid {session.peer.pid}) has ended: it may read"
        " and stop; to do more, open another connection"
    )
    return Refusal("client_lost", text)


def _malformed(session: Session, request: Request, method: Method) -> Refusal | None:
    params = request.params
    refusal = check(method.name, method.declared, params)
    if refusal is not None:
        return refusal
    if request.identity is None and not method.may_notify:
        text = f'{method.name} needs an "id": its answer would otherwise get lost'
        return Refusal("invalid_request", text)
    waits = method.waits and params.get("wait", True)
    if waits and session.unanswered >= MAX_PER_SESSION:
        text = f"{MAX_PER_SESSION} requests of this connection wait for an answer already"
        return Refusal("too_many_requests", text, {"limit": MAX_PER_SESSION})
    if params.get("progress") and not waits:
        text = f"{method.name}: progress is sent only to who waits; leave wait or progress out"
        return Refusal("invalid_params", text, {"parameter": "progress"})
    return None
