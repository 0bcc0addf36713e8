"""The requests of all clients: checked, carried out on the engine, answered.

Pure: lines come in through `handle`, lines go out through the sessions, time is an argument.
Whatever a line holds, `handle` answers it and does not raise.
"""

from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.model.events import Event
from litegripd.model.jobs import Job, Owner
from litegripd.rpc.facts import Facts
from litegripd.rpc.handlers import Answer, Handlers, Later
from litegripd.rpc.methods import BY_NAME, Method
from litegripd.rpc.reporter import Reporter
from litegripd.rpc.schema import check
from litegripd.rpc.session import Peer, Session
from litegripd.rpc.subscriptions import Subscriptions
from litegripd.rpc.view import progress_view
from litegripd.rpc.waiting import MAX_PER_SESSION, Waiter, WaitingRoom
from litegripd.rpc.wire import (
    BadRequest,
    Request,
    RequestId,
    encode,
    error_line,
    notification_line,
    parse,
    result_line,
)


class RpcService:
    """Implements `Service` on one engine."""

    def __init__(self, engine: Engine, facts: Facts, period_s: float) -> None:
        self.refused = 0
        self._engine = engine
        self.reporter = Reporter(engine, period_s)
        self._subscriptions = Subscriptions()
        self._waiting = WaitingRoom()
        self._handlers = Handlers(engine, facts, self._subscriptions, self.reporter)
        self._last_session = 0
        self._events: list[Event] = []

    # Service ------------------------------------------------------------------------------------

    def opened(self, peer: Peer, _now_s: float) -> Session:
        """Begin a session for a new connection."""
        self._last_session += 1
        return Session(self._last_session, peer)

    def closed(self, session: Session, _now_s: float) -> None:
        """End a session; what its connection owned is lost with it."""
        self._subscriptions.remove_all(session)
        self._waiting.remove_all(session)
        self._engine.client_lost(session.identity)

    def is_idle(self, session: Session) -> bool:
        """Whether nothing will be sent to `session` that it has not asked for anew."""
        return not session.unanswered and not self._subscriptions.any_of(session)

    def handle(self, session: Session, line: bytes, now_s: float) -> None:
        """Answer one line, at once or when the motion that it asked for has ended."""
        request = parse(line)
        if isinstance(request, BadRequest):
            self._refuse(session, request.identity, request.refusal)
        elif request.method == "state.get" and not request.params and request.identity is not None:
            session.write(result_line(request.identity, self.reporter.state_line()))
        else:
            self._call(session, request, now_s)

    # The tick -------------------------------------------------------------------------------------

    def after_tick(self, now_s: float, bus_is_up: bool) -> None:
        """Answer whoever waits for a job that has ended; find what is to be sent."""
        self.reporter.tick(now_s, bus_is_up)
        self.reporter.keep_end_states()
        self._answer_waiters()
        self._send_progress(now_s)
        self._subscriptions.tick(now_s)

    @property
    def pending(self) -> bool:
        """Whether samples wait to be sent."""
        return self._subscriptions.pending

    def send_one(self) -> None:
        """Send one sample; the transport calls this in the time that it has."""
        self._subscriptions.send_one(self.reporter.state())

    def take_events(self) -> list[Event]:
        """Return what happened since the last call."""
        events = self._engine.take_events() + self._events
        self._events = []
        return events

    # Inside ---------------------------------------------------------------------------------------

    def _call(self, session: Session, request: Request, now_s: float) -> None:
        method = BY_NAME.get(request.method)
        if method is None:
            text = f"there is no method {request.method[:64]!r}; rpc.discover lists them"
            self._refuse(session, request.identity, Refusal("unknown_method", text))
            return
        refusal = self._refusal(session, request, method)
        if refusal is not None:
            self._refuse(session, request.identity, refusal)
            return
        owner = Owner(session.identity, session.peer.pid, session.peer.uid, session.name)
        try:
            answer = self._handlers.call(request.method, session, owner, request.params, now_s)
            self._answer(session, request, answer)
        except Exception as error:  # noqa: BLE001 - no request ends the daemon
            text = f"{request.method} failed by a defect: {type(error).__name__}: {error}"
            self._refuse(session, request.identity, Refusal("internal_error", text))

    def _refusal(self, session: Session, request: Request, method: Method) -> Refusal | None:
        params = request.params
        refusal = check(method.name, method.declared, params)
        if refusal is not None:
            return refusal
        if request.identity is None:
            text = f'{method.name} needs an "id": its answer would otherwise get lost'
            return Refusal("invalid_request", text)
        if session.unanswered >= MAX_PER_SESSION:
            text = f"{MAX_PER_SESSION} requests of this connection wait for an answer already"
            return Refusal("too_many_requests", text, {"limit": MAX_PER_SESSION})
        if method.moves:
            latch = self._engine.stop_latch
            return latch.refusal_of_sent(params.get("stop_generation"), params.get("sent_s"))
        return None

    def _answer(self, session: Session, request: Request, answer: Answer) -> None:
        if isinstance(answer, Refusal):
            self._refuse(session, request.identity, answer)
        elif not isinstance(answer, Later):
            session.write(result_line(request.identity, encode(answer)))
        elif answer.wants_job or request.params.get("wait", True):
            progress = request.params.get("progress", False)
            waiter = Waiter(session, request.identity, answer.wants_job, progress)
            self._waiting.add(answer.job.number, waiter)
        else:
            session.write(result_line(request.identity, encode({"job": answer.job.number})))

    def _refuse(self, session: Session, identity: RequestId, refusal: Refusal) -> None:
        self.refused += 1
        peer = session.peer
        text = f"refused {session.name} (pid {peer.pid}, uid {peer.uid}): {refusal.message}"
        self._events.append(Event("refused", text, {"reason": refusal.reason}))
        session.write(error_line(identity, refusal))

    def _answer_waiters(self) -> None:
        for number in self._waiting.jobs():
            job = self._engine.jobs.get(number)
            if job is not None and job.is_running:
                continue
            for waiter in self._waiting.take(number):
                waiter.session.write(self._final_line(waiter, job))

    def _final_line(self, waiter: Waiter, job: Job | None) -> bytes:
        if job is None:
            text = "the job has ended so long ago that it is no longer kept"
            return error_line(waiter.request, Refusal("unknown_job", text))
        if waiter.wants_job:
            return result_line(waiter.request, encode(self.reporter.job(job)))
        result = self.reporter.result(job)
        if result is None:
            ended = job.error or Refusal("internal_error", f"job {job.number} ended without result")
            return error_line(waiter.request, ended)
        return result_line(waiter.request, encode(result))

    def _send_progress(self, now_s: float) -> None:
        job, progress = self._engine.jobs.running, self._engine.progress()
        if job is None or progress is None:
            return
        for waiter in self._waiting.due_progress(job.number, now_s):
            opening_mm = self.reporter.state().opening_mm
            view = progress_view(job, waiter.request, progress, opening_mm)
            waiter.session.write(notification_line("job.progress", encode(view)))
