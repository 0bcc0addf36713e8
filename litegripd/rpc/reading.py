"""The methods that read: who is there, the state, the jobs. They change nothing."""

from collections.abc import Mapping

from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job
from litegripd.rpc.calls import Answer, Call, Function, Later
from litegripd.rpc.facts import Facts
from litegripd.rpc.openrpc import encoded_document
from litegripd.rpc.reports import Reporter
from litegripd.rpc.sessions import Clients


class Reading:
    """Functions on the daemon's facts, the state and the jobs."""

    def __init__(self, engine: Engine, facts: Facts, clients: Clients, reporter: Reporter) -> None:
        self._engine = engine
        self._reporter = reporter
        self._facts = facts
        self._clients = clients

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        document = encoded_document()  # made here: it takes longer than a tick
        return {
            "hello": self._hello,
            "rpc.discover": lambda _call: document,
            "health": lambda call: self._facts.health(call.now_s),
            "info.get": lambda _call: self._facts.info(),
            "state.get": lambda _call: self._reporter.state_line(),
            "clients.list": lambda call: self._clients.listing(call.session, call.now_s),
            "job.list": self._list_jobs,
            "job.get": self._get_job,
            "job.wait": self._wait_for_job,
        }

    def _hello(self, call: Call) -> Answer:
        call.session.name = call.params.get("client", call.session.name)
        session, generation = call.session, self._engine.stop_latch.generation
        own = {"client": session.identity, "role": session.role, "monotonic_s": call.now_s}
        return {**self._facts.hello(), **own, "stop_generation": generation}

    def _list_jobs(self, _call: Call) -> Answer:
        return b'{"jobs":[%b]}' % b",".join(map(self._reporter.job, self._engine.jobs))

    def _get_job(self, call: Call) -> Answer:
        job = self._job(call)
        return job if isinstance(job, Refusal) else self._reporter.job(job)

    def _wait_for_job(self, call: Call) -> Answer:
        job = self._job(call)
        return job if isinstance(job, Refusal) else Later(job, wants_job=True)

    def _job(self, call: Call) -> Job | Refusal:
        number = call.params["job"]
        job = self._engine.jobs.get(number)
        if job is None:
            text = f"there is no job {number}, or it is no longer kept; job.list tells which are"
            return Refusal("unknown_job", text, {"requested": number})
        return job
