"""The service: requests are admitted by role, lease and stop, and carried out; answers follow."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import get_args

from litegripd.control.controller import Controller
from litegripd.control.events import Turn
from litegripd.model.errors import Refusal
from litegripd.model.plain import Carried
from litegripd.model.sentence import method_name, sentence, with_plain_start, with_terms
from litegripd.model.state import Event, Job, JobKind, Owner
from litegripd.rpc.jsonrpc import (
    BadRequest,
    Request,
    RequestId,
    asked_stop,
    encode,
    error_line,
    error_object,
    notification_line,
    numbered_line,
    parse,
    result_line,
    state_asked,
)
from litegripd.rpc.method import (
    Answer,
    Call,
    Deferred,
    Feature,
    Later,
    Method,
    Refused,
    Result,
    check,
    functions_of,
    later,
    methods_of,
)
from litegripd.rpc.methods import CORE
from litegripd.rpc.methods.lease import LeaseMethods, Tokens
from litegripd.rpc.methods.motion import MotionMethods
from litegripd.rpc.methods.reading import ReadingMethods
from litegripd.rpc.methods.settings import SettingsMethods
from litegripd.rpc.reports import MAX_PER_SESSION, Facts, Reporter, Waiter, Waiters, defect
from litegripd.rpc.sessions import ROLES, Clients, Peer, Role, Session, not_permitted
from litegripd.rpc.subscriptions import EventLog, Subscriptions

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
        if method.of_older is not None:
            request = request._replace(params=method.of_older(request.params))
        params = request.params
        refusal = _malformed(session, request, method)
        if refusal is None and method.stop_voids:
            generation, sent_s = params.get("stop_generation"), params.get("sent_s")
            refusal = self._controller.stop_latch.refusal_of_sent(
                generation,
                sent_s,
                received_s,
                session.identity,
                clears=method.name == "stop.clear",
            )
        if refusal is not None:
            return refusal
        owner, token = session.owner, params.get("lease")
        if token is not None:
            owner = replace(owner, grant=self._tokens.number(token))
        refusal = self._forbidden(session, method, owner)
        return refusal or Call(session, owner, params, now_s, received_s)

    def carry_out(self, method: Method, call: Call) -> Answer:
        """Carry out an admitted request."""
        answer = self._admitted(method, call)
        if method.needs_lease and isinstance(answer, Refusal):
            self._controller.note_refused(answer)
        return answer

    def _admitted(self, method: Method, call: Call) -> Answer:
        key = call.params.get("key")
        if key is None:
            return self._carried_out(method, call) if not call.params else self._begin(method, call)
        known = self._controller.jobs.find(call.owner, key)
        if known is not None and known.kind != _kind_of(method):
            text = (
                f"the key {key!r} names job {known.number}, {known.kind}: give this motion its own"
            )
            return Refusal("invalid_params", text, {"parameter": "key", "job": known.number})
        if known is not None:
            return Later(known)
        answer = self._begin(method, call)
        if isinstance(answer, Later):
            answer.job.key = key
        return answer

    def _begin(self, method: Method, call: Call) -> Answer:
        """Carry it out at once, in place of the caller's own motion, or after the running one."""
        if_busy, in_the_way = call.params.get("if_busy"), self._controller.in_the_way()
        if if_busy is None or in_the_way is None:
            return self._carried_out(method, call)
        kind = _kind_of(method)
        running = self._controller.jobs.running
        if if_busy == "replace" and running is not None and _is_own(running, call.owner):
            who = f"{call.owner.program} (pid {call.owner.pid})"
            text = f"{who} began another motion in its place: {kind or method.name}"
            reason = Refusal("replaced", text)
            return self._carried_out(method, call._replace(turn=Turn(replaces=reason)))
        if if_busy == "queue" and kind is not None:

            def start(turn: Turn) -> Job | Refusal:
                answer = self._carried_out(method, call._replace(turn=turn))
                if isinstance(answer, Later):
                    return answer.job
                if isinstance(answer, Refusal):
                    return answer
                return Refusal("internal_error", "a queued request began no motion")

            jobs, now_s = self._controller.jobs, self._controller.now_s
            return later(jobs.enqueue(kind, call.owner, call.detached, now_s, start))
        return self._carried_out(method, call)

    def _carried_out(self, method: Method, call: Call) -> Answer:
        try:
            return self._functions[method.name](call)
        except Refused as refused:
            return refused.refusal

    def _forbidden(self, session: Session, method: Method, owner: Owner) -> Refusal | None:
        """Return a refusal for the daemon's end, the sender's role or the lease, or None."""
        if self._controller.ending is not None and method.role != "observer":
            return self._controller.ending  # any change would be lost; a stop and reads are for all
        if session.is_orphaned and method.role != "observer":
            text = (  # another process has its connection now
                f"the process that opened this connection (pid {session.peer.pid}) has ended: it"
                " may read and stop; to do more, open another connection"
            )
            return Refusal("client_lost", text)
        latch = self._controller.stop_latch
        if method.lifts_stop and latch.may_be_cleared_by(
            session.owner.user, alone=session.role == "observer"
        ):
            return None
        if _RANKS[session.role] < _RANKS[method.role]:
            return not_permitted(session, method.role, method_name(method.name))
        refusal = self._controller.lease.refusal(owner) if method.needs_lease else None
        if refusal is not None and method.lifts_stop:
            is_admin = session.role == "admin"
            return None if is_admin else latch.clearing_refusal(refusal)
        return refusal


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


class RpcService:
    """Implements `Service` on one controller, with the methods of the core and of `features`.

    `document` describes them, as JSON.
    """

    _last_session: Carried[int] = 0
    _subscriptions: Carried[Subscriptions]
    _tokens: Carried[Tokens]
    NOT_CARRIED = (
        "on_event",
        "refused",
        "reporter",  # its ends of jobs follow later
        "_clients",
        "_controller",
        "_event_log",
        "_features",
        "_is_gateway",
        "_methods",
        "_now_s",
        "_requests",
        "_role_of",
        "_waiters",
    )

    def __init__(
        self,
        controller: Controller,
        facts: Facts,
        period_s: float,
        features: Callable[[Reporter], Sequence[Feature]],
        *,
        document: bytes,
        role_of: Callable[[Peer], Role],
        is_gateway: Callable[[Peer], bool],
        new_token: Callable[[], str],
    ) -> None:
        self.refused = 0
        self.on_event: Callable[[Event, float], None] = lambda _event, _now_s: None
        """Called with every event and its time."""
        self._role_of = role_of
        self._is_gateway = is_gateway
        self._controller = controller
        self.reporter = Reporter(controller, period_s)
        self._clients = Clients()
        self._subscriptions = Subscriptions()
        self._waiters = Waiters(controller, self.reporter)
        self._tokens = Tokens(new_token)
        self._features = features(self.reporter)
        added = [group for feature in self._features for group in feature.groups]
        kinds = (*CORE, *map(type, added))
        motor_type = controller.gripper_id.motor_type
        rows = [row.with_motor(motor_type) for kind in kinds for row in methods_of(kind)]
        groups = (
            ReadingMethods(
                controller,
                facts,
                self._clients,
                self.reporter,
                self._subscriptions,
                document=document,
            ),
            LeaseMethods(controller, self._clients, self._tokens, self.reporter),
            MotionMethods(controller, self.reporter),
            SettingsMethods(controller),
            *added,
        )
        self._methods = {row.name: row for row in rows}
        self._requests = Requests(controller, self._tokens, self._methods, groups)
        self._event_log = EventLog()
        self._now_s = 0.0

    # Service ------------------------------------------------------------------------------------

    def opened(self, peer: Peer, now_s: float) -> Session:
        """Begin a session for a new connection."""
        self._last_session += 1
        session = Session(self._last_session, peer, now_s)
        session.role = self._role_of(peer)
        session.is_gateway = self._is_gateway(peer)
        self._clients.add(session)
        return session

    def closed(self, session: Session, now_s: float) -> None:
        """End a session; what its connection owned is lost with it."""
        session.is_orphaned = True
        self._clients.remove(session)
        self._subscriptions.remove_all(session)
        self._waiters.remove_all(session)
        for feature in self._features:
            feature.session_ended(session)
        self._controller.client_lost(session.identity)
        self._collect_events(now_s)

    def process_ended(self, session: Session, now_s: float) -> None:
        """End what a lost process owned, though a forked child has its connection."""
        session.is_orphaned = True
        for feature in self._features:
            feature.session_ended(session)
        self._controller.client_lost(session.identity, "process")
        self._collect_events(now_s)

    def is_idle(self, session: Session) -> bool:
        """Return True if the session has no pending answers and no subscriptions."""
        return not session.unanswered and not session.subscriptions

    def handle(
        self, session: Session, line: bytes, now_s: float, received_s: float | None = None
    ) -> None:
        """Answer one line, at once or when the motion that it requested has ended.

        `received_s` is when the line came; by default that is now. A line from before a stop does
        not run after it.
        """
        self._now_s = now_s
        session.counters.requests += 1
        try:
            number = state_asked(line)
            if number is not None:  # everybody may ask for it at any time
                self._controller.lease.renew(session.identity, now_s)
                session.write(numbered_line(number, self.reporter.state_line()))
            else:
                came_s = now_s if received_s is None or received_s > now_s else received_s
                self._handle_any(session, line, now_s, came_s)
        except Exception as error:  # noqa: BLE001 - no request ends the daemon
            self._refuse(session, parse(line).identity, defect("the request", error))
        self._collect_events(now_s)

    # The tick -------------------------------------------------------------------------------------

    def after_tick(self, now_s: float) -> None:
        """Answer the requests whose job has ended; find what is to be sent."""
        self._collect_events(now_s)
        self.reporter.tick(now_s)
        self.reporter.keep_ends()
        self._waiters.answer()
        self._waiters.send_progress(now_s)
        self._subscriptions.tick(now_s)

    @property
    def pending(self) -> bool:
        """True if events or samples wait to be sent."""
        return self._subscriptions.pending

    def send_one(self) -> None:
        """Serve one subscription; the transport calls this in the time that it has."""
        self._subscriptions.send_one(self.reporter.state)

    def take_events(self) -> list[Event]:
        """Return the events, the oldest first, as many as a tick can log.

        Further refusals in a flood are counted and reported as one event.
        """
        self._collect_events(self._now_s)
        return self._event_log.take()

    # Inside ---------------------------------------------------------------------------------------

    def _handle_any(self, session: Session, line: bytes, now_s: float, received_s: float) -> None:
        request = parse(line)
        if isinstance(request, BadRequest):
            refusal = self._stop_all_the_same(session, line, request.refusal, now_s)
            self._refuse(session, request.identity, refusal)
        else:
            self._call(session, request, line, now_s, received_s)

    def _call(
        self, session: Session, request: Request, line: bytes, now_s: float, received_s: float
    ) -> None:
        method = self._methods.get(request.method)
        if method is None:
            text = sentence(
                "there is no method {asked!r}; {rpc.discover} lists them", asked=request.method[:64]
            )
            self._refuse(session, request.identity, Refusal("unknown_method", text))
            return
        call = self._requests.admit(session, request, method, now_s, received_s)
        if isinstance(call, Refusal):
            refusal = self._stop_all_the_same(session, line, call, now_s)
            self._turn_down(session, request, method, refusal)
            return
        answer = self._requests.carry_out(method, call)
        if method.may_notify and request.identity is None:
            self._turn_down(
                session, request, method, answer if isinstance(answer, Refusal) else None
            )
        else:
            if method.may_notify and not isinstance(answer, Refusal):
                session.turned_down.pop(method.name, None)
            self._answer(session, request, answer)

    def _answer(self, session: Session, request: Request, answer: Answer) -> None:
        if isinstance(answer, Refusal):
            self._refuse(session, request.identity, answer)
        elif isinstance(answer, Later):
            job, params = answer.job, request.params
            if answer.wants_job or params.get("wait", True):
                progress = params.get("progress", False)
                waiter = Waiter(session, request.identity, job, answer.wants_job, progress)
                self._waiters.add(waiter)
            else:
                session.write(result_line(request.identity, encode({"job": job.number})))
        elif isinstance(answer, Deferred):
            session.unanswered += 1
            answer.then(lambda result: self._answer_deferred(session, request, result))
        elif request.identity is not None:
            result = answer if isinstance(answer, bytes) else encode(with_terms(answer))
            session.write(result_line(request.identity, result))

    def _answer_deferred(self, session: Session, request: Request, result: Result) -> None:
        session.unanswered -= 1
        self.reporter.refresh()
        self._answer(session, request, result)

    def _stop_all_the_same(
        self, session: Session, line: bytes, refusal: Refusal, now_s: float
    ) -> Refusal:
        """Stop if a rejected line asks for it, in any spelling; return the refusal."""
        asked = asked_stop(line)
        if asked is None:
            return refusal
        why = asked.why or "a stop request that was not understood"
        self._controller.stop(asked.level, session.owner, why, now_s)
        self.reporter.refresh()
        text = sentence(
            "{why}; stopped ({level}) all the same", why=refusal.message, level=asked.level
        )
        return replace(refusal, message=text)

    def _refuse(self, session: Session, identity: RequestId, refusal: Refusal) -> None:
        session.counters.refused += 1
        self._log_refusal(session, refusal)
        session.write(error_line(identity, refusal))

    def _log_refusal(self, session: Session, refusal: Refusal) -> None:
        self.refused += 1
        peer = session.peer
        text = sentence(
            "refused {name} (pid {pid}, uid {uid}): {why}",
            name=session.name,
            pid=peer.pid,
            uid=peer.uid,
            why=with_plain_start(refusal.message),  # what was called, whichever client did
        )
        self._collect_events(self._now_s)  # earlier events
        data = {"reason": refusal.reason, "client": session.identity, "pid": peer.pid}
        self._note(Event("refused", text, data), self._now_s)

    def _turn_down(
        self, session: Session, request: Request, method: Method, refusal: Refusal | None
    ) -> None:
        """Reject a request; a notification's client gets one event per change of reason."""
        if request.identity is not None or not method.may_notify:
            if refusal is not None:
                self._refuse(session, request.identity, refusal)
            return
        session.counters.refused += refusal is not None
        before = session.turned_down.pop(method.name, None)
        if refusal is None:
            return
        session.turned_down[method.name] = refusal.reason
        if refusal.reason != before:
            self._log_refusal(session, refusal)
            session.write(notification_line(method.refused_as, encode(error_object(refusal))))

    def _collect_events(self, now_s: float) -> None:
        """Take the gripper's events since the last call."""
        self._now_s = now_s
        if self._controller.events:
            for event in self._controller.take_events():
                self._note(event, now_s)

    def _note(self, event: Event, now_s: float) -> None:
        """Keep an event for the log, and for the subscribers to its kind."""
        self._event_log.note(event)
        self.on_event(event, now_s)
        self._subscriptions.events.note(event, now_s)
        if event.kind == "lease_lost":
            loser = self._clients.get(event.data["client"])
            if loser is not None:
                loser.write(notification_line("lease.lost", encode(event.data)))
