"""The methods that read: who is there, the state, the jobs. They change nothing."""

from collections.abc import Mapping

from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job
from litegripd.rpc.calls import Answer, Call, Function, Later
from litegripd.rpc.facts import Facts
from litegripd.rpc.openrpc import encoded_document
from litegripd.rpc.reporter import Reporter
from litegripd.rpc.subscriptions import Subscriptions

DEFAULT_SAMPLE_HZ = 20.0


class Reading:
    """Functions on the daemon's facts, the state and the jobs."""

    def __init__(
        self, engine: Engine, facts: Facts, subscriptions: Subscriptions, reporter: Reporter
    ) -> None:
        self._engine = engine
        self._reporter = reporter
        self._facts = facts
        self._subscriptions = subscriptions

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "hello": self._hello,
            "rpc.discover": lambda _call: encoded_document(),
            "health": lambda call: self._facts.health(call.now_s),
            "info.get": lambda _call: self._facts.info(),
            "state.get": lambda _call: self._reporter.state_line(),
            "state.subscribe": self._subscribe,
            "state.unsubscribe": self._unsubscribe,
            "job.list": self._list_jobs,
            "job.get": self._get_job,
            "job.wait": self._wait_for_job,
        }

    def _hello(self, call: Call) -> Answer:
        call.session.name = call.params.get("client", call.session.name)
        generation = self._engine.stop_latch.generation
        return {**self._facts.hello(), "stop_generation": generation}

    def _subscribe(self, call: Call) -> Answer:
        hz = float(call.params.get("hz", DEFAULT_SAMPLE_HZ))
        if hz > self._reporter.rate_hz:
            text = f"hz is {hz:g}, it must be at most the control rate, {self._reporter.rate_hz:g}"
            data = {"parameter": "hz", "requested": hz, "limit": self._reporter.rate_hz}
            return Refusal("invalid_params", f"state.subscribe: {text}", data)
        names = call.params.get("fields", ())
        sub = self._subscriptions.add(call.session, hz, names, call.now_s)
        if isinstance(sub, Refusal):
            return sub
        return {"subscription": sub.number, "state": self._reporter.state_view()}

    def _unsubscribe(self, call: Call) -> Answer:
        number = call.params["subscription"]
        if not self._subscriptions.remove(number, call.session):
            text = f"this connection has no subscription {number}"
            return Refusal("invalid_params", text, {"parameter": "subscription"})
        return {"subscription": number}

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
