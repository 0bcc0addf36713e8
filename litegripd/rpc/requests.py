"""A request on its way: what it must pass, and how it is carried out.

It must pass the checks of its parameters, its sender's role, the lease and the stops. It is carried
out at once, in place of another motion, or after it. A request whose key names a job that is still
kept starts nothing: it gets that job's answer.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import get_args

from litegripd.control.admission import ENDING
from litegripd.control.controller import Controller
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, JobKind, Owner
from litegripd.rpc.jsonrpc import Request
from litegripd.rpc.method import Answer, Call, Later, Method, Refused, functions_of, later
from litegripd.rpc.methods.lease import Tokens
from litegripd.rpc.reports import MAX_PER_SESSION
from litegripd.rpc.schema import check
from litegripd.rpc.sessions import ROLES, Role, Session

_RANKS: Mapping[Role, int] = {role: rank for rank, role in enumerate(ROLES)}
_KINDS: Mapping[str, JobKind] = {kind: kind for kind in get_args(JobKind)}


class Requests:
    """Admits requests, and passes the admitted ones to their functions."""

    def __init__(
        self,
        controller: Controller,
        tokens: Tokens,
        methods: Collection[str],
        groups: Iterable[object],
    ) -> None:
        """Store the objects whose functions carry out the methods, all of them.

        Raises `LookupError` if a method has no object, or an object has other methods.
        """
        self._controller = controller
        self._tokens = tokens
        self._functions = {
            name: function for group in groups for name, function in functions_of(group).items()
        }
        differing = self._functions.keys() ^ set(methods)
        if differing:
            raise LookupError(f"methods without an object, or objects without a row: {differing}")

    def admit(
        self,
        session: Session,
        request: Request,
        method: Method,
        now_s: float,
        received_s: float,
    ) -> Call | Refusal:
        """Return a request as its function takes it, or a refusal."""
        self._controller.lease.renew(session.identity, now_s)
        refusal = _malformed(session, request, method)
        if refusal is None and method.stop_voids:
            refusal = self._void(session, request, received_s)
        if refusal is not None:
            return refusal
        owner, token = session.owner, request.params.get("lease")
        if token is not None:
            owner = replace(owner, grant=self._tokens.number(token))
        refusal = self._forbidden(session, method, owner)
        return refusal or Call(session, owner, request.params, now_s, received_s)

    def carry_out(self, method: Method, call: Call) -> Answer:
        """Carry out an admitted request."""
        key = call.params.get("key")
        if key is None:
            return self._carried_out(method, call) if not call.params else self._begin(method, call)
        known = self._controller.jobs.find(call.owner, key)
        if known is not None:
            return _repeated(known, _kind_of(method), str(key))
        answer = self._begin(method, call)
        if isinstance(answer, Later):
            answer.job.key = key
        return answer

    def _begin(self, method: Method, call: Call) -> Answer:
        """Carry it out at once, in place of the caller's own motion, or after the running one."""
        if_busy, running = call.params.get("if_busy"), self._controller.jobs.running
        if if_busy is None or running is None:
            return self._carried_out(method, call)
        kind = _kind_of(method)
        if if_busy == "replace" and _is_own(running, call.owner):
            reason = Refusal("replaced", f"{method.name} of the same client replaced it")
            return self._controller.replace(reason, lambda: self._carried_out(method, call))
        if if_busy == "queue" and kind is not None:
            begin = lambda: _job_of(self._carried_out(method, call))  # noqa: E731
            return later(self._controller.queue(kind, call.owner, call.detached, begin))
        return self._carried_out(method, call)

    def _carried_out(self, method: Method, call: Call) -> Answer:
        try:
            return self._functions[method.name](call)
        except Refused as refused:
            return refused.refusal

    def _void(self, session: Session, request: Request, received_s: float) -> Refusal | None:
        """Return a refusal if a request was sent, or received, before the latest stop."""
        params = request.params
        latch = self._controller.stop_latch
        return latch.refusal_of_sent(
            params.get("stop_generation"), params.get("sent_s"), received_s, session.identity
        )

    def _forbidden(self, session: Session, method: Method, owner: Owner) -> Refusal | None:
        """Return a refusal for the daemon's end, the sender's role or the lease, or None."""
        if self._controller.is_ending and method.role != "observer":
            return ENDING  # any change would be lost; a stop and reads are for all
        if session.is_orphaned and method.role != "observer":
            return _orphaned(session)
        if method.lifts_stop and self._has_stopped(session):
            return None
        if _RANKS[session.role] < _RANKS[method.role]:
            text = f"{method.name} needs the role {method.role}; uid {owner.uid} is {session.role}"
            return Refusal("not_permitted", text, {"needs": method.role, "role": session.role})
        refusal = self._controller.lease.refusal(owner) if method.needs_lease else None
        if refusal is not None and method.lifts_stop:
            is_admin = session.role == "admin"
            return None if is_admin else self._controller.stop_latch.clearing_refusal(refusal)
        return refusal

    def _has_stopped(self, session: Session) -> bool:
        latch, is_observer = self._controller.stop_latch, session.role == "observer"
        return latch.may_be_cleared_by(session.peer.uid, alone=is_observer)


def _orphaned(session: Session) -> Refusal:
    """Return a refusal if the accepted process is gone: another one has its connection now."""
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


def _kind_of(method: Method) -> JobKind | None:
    return _KINDS.get(method.name.rpartition(".")[2])


def _is_own(running: Job, owner: Owner) -> bool:
    """Return True if a request for another motion may end a motion."""
    same_lease = running.grant is not None and running.grant == owner.grant
    return same_lease or running.owner.client == owner.client


def _repeated(known: Job, kind: JobKind | None, key: str) -> Answer:
    if known.kind != kind:
        text = f"the key {key!r} names job {known.number}, {known.kind}: give this motion its own"
        return Refusal("invalid_params", text, {"parameter": "key", "job": known.number})
    return Later(known)


def _job_of(answer: Answer) -> Job | Refusal:
    """Return the job that a function has begun in its turn."""
    if isinstance(answer, Later):
        return answer.job
    if isinstance(answer, Refusal):
        return answer
    return Refusal("internal_error", "a queued request began no motion")
