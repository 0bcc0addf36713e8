"""What each method does: one function a method, found by its name in the table."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, Owner
from litegripd.rpc.facts import Facts
from litegripd.rpc.methods import METHODS
from litegripd.rpc.openrpc import encoded_document
from litegripd.rpc.reporter import Reporter
from litegripd.rpc.session import Session
from litegripd.rpc.subscriptions import Subscriptions

DEFAULT_SAMPLE_HZ = 20.0


@dataclass(frozen=True, slots=True)
class Later:
    """The answer comes when `job` has ended: its result, or the job itself."""

    job: Job
    wants_job: bool = False


@dataclass(frozen=True, slots=True)
class Call:
    """One request on its way to its function."""

    session: Session
    owner: Owner
    params: Mapping[str, Any]
    now_s: float

    @property
    def detached(self) -> bool:
        """Whether the motion outlives its connection: asked for, or not waited for."""
        return bool(self.params.get("detach", False)) or not self.params.get("wait", True)


Answer: TypeAlias = Mapping[str, Any] | bytes | Refusal | Later
"""A result at once, as a value or as JSON, a refusal, or an answer later."""


class Handlers:
    """The functions of all methods; a missing one fails at construction, not at a call."""

    def __init__(
        self, engine: Engine, facts: Facts, subscriptions: Subscriptions, reporter: Reporter
    ) -> None:
        self._engine = engine
        self._reporter = reporter
        self._facts = facts
        self._subscriptions = subscriptions
        self._functions: dict[str, Callable[[Call], Answer]] = {
            method.name: getattr(self, "_" + method.name.replace(".", "_")) for method in METHODS
        }

    def call(
        self,
        method: str,
        session: Session,
        owner: Owner,
        params: Mapping[str, Any],
        now_s: float,
    ) -> Answer:
        """Carry out a request whose parameters have been checked."""
        return self._functions[method](Call(session, owner, params, now_s))

    def _hello(self, call: Call) -> Answer:
        call.session.name = call.params.get("client", call.session.name)
        generation = self._engine.stop_latch.generation
        return {**self._facts.hello(), "stop_generation": generation}

    def _rpc_discover(self, _call: Call) -> Answer:
        return encoded_document()

    def _health(self, call: Call) -> Answer:
        return self._facts.health(call.now_s)

    def _info_get(self, _call: Call) -> Answer:
        return self._facts.info()

    def _state_get(self, _call: Call) -> Answer:
        return self._reporter.state_line()

    def _state_subscribe(self, call: Call) -> Answer:
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

    def _state_unsubscribe(self, call: Call) -> Answer:
        number = call.params["subscription"]
        if not self._subscriptions.remove(number, call.session):
            text = f"this connection has no subscription {number}"
            return Refusal("invalid_params", text, {"parameter": "subscription"})
        return {"subscription": number}

    def _motor_enable(self, call: Call) -> Answer:
        on_lost = call.params.get("on_lost", "hold")
        retries = call.params.get("retries")
        return _later(self._engine.enable(call.owner, retries, call.detached, on_lost))

    def _motor_keep(self, call: Call) -> Answer:
        return {"kept": self._engine.keeping.change(call.owner.client, call.params["on_lost"])}

    def _motor_disable(self, call: Call) -> Answer:
        return _later(self._engine.disable(call.owner, call.detached))

    def _motion_open(self, call: Call) -> Answer:
        speed = call.params.get("speed_mm_s")
        return _later(self._engine.move("open", call.owner, speed, call.detached))

    def _motion_close(self, call: Call) -> Answer:
        speed = call.params.get("speed_mm_s")
        return _later(self._engine.move("close", call.owner, speed, call.detached))

    def _motion_hold(self, call: Call) -> Answer:
        return _later(self._engine.hold(call.owner))

    def _stop(self, call: Call) -> Answer:
        level, why = call.params.get("level", "hold"), call.params.get("why")
        self._engine.stop(level, call.owner, why, call.now_s)
        latched = self._engine.stop_latch.latched
        return {
            "level": level if latched is None else latched.level,
            "generation": self._engine.stop_latch.generation,
            "state": self._changed_state(),
        }

    def _stop_clear(self, call: Call) -> Answer:
        self._engine.clear_stop(call.owner)
        return {"generation": self._engine.stop_latch.generation, "state": self._changed_state()}

    def _job_list(self, _call: Call) -> Answer:
        return b'{"jobs":[%b]}' % b",".join(map(self._reporter.job, self._engine.jobs))

    def _job_get(self, call: Call) -> Answer:
        job = self._job(call)
        return job if isinstance(job, Refusal) else self._reporter.job(job)

    def _job_wait(self, call: Call) -> Answer:
        job = self._job(call)
        return job if isinstance(job, Refusal) else Later(job, wants_job=True)

    def _job_cancel(self, call: Call) -> Answer:
        job = self._engine.cancel(call.params["job"], call.owner)
        self._reporter.refresh()
        return job if isinstance(job, Refusal) else self._reporter.job(job)

    def _changed_state(self) -> dict[str, Any]:
        """Return the state as this request has left it."""
        self._reporter.refresh()
        return self._reporter.state_view()

    def _job(self, call: Call) -> Job | Refusal:
        number = call.params["job"]
        job = self._engine.jobs.get(number)
        if job is None:
            text = f"there is no job {number}, or it is no longer kept; job.list tells which are"
            return Refusal("unknown_job", text, {"requested": number})
        return job


def _later(job: Job | Refusal) -> Answer:
    return job if isinstance(job, Refusal) else Later(job)
