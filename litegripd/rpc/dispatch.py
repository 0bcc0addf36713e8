"""Carries out a request that may be: at once, in place of another motion, or after it.

A request whose key names a job that is still kept does nothing anew: it gets that job's answer.
"""

from collections.abc import Iterable, Mapping
from typing import Any, get_args

from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, JobKind, Owner
from litegripd.rpc.method import Answer, Call, Later, Method, functions_of, is_detached
from litegripd.rpc.methods import BY_NAME
from litegripd.rpc.sessions import Session

_KINDS: Mapping[str, JobKind] = {kind: kind for kind in get_args(JobKind)}


class Dispatch:
    """Passes requests to their functions."""

    def __init__(self, engine: Engine, groups: Iterable[object]) -> None:
        self._engine = engine
        self._functions = {
            name: function for group in groups for name, function in functions_of(group).items()
        }
        differing = self._functions.keys() ^ BY_NAME.keys()
        if differing:
            raise LookupError(
                f"methods that no object of the service has, or the other way round: {differing}"
            )

    def carry_out(
        self,
        method: Method,
        session: Session,
        owner: Owner,
        params: Mapping[str, Any],
        now_s: float,
        *,
        received_s: float,
    ) -> Answer:
        """Carry out a request that has been checked and is allowed."""
        key = params.get("key")
        known = None if key is None else self._engine.jobs.find(owner, key)
        kind = _KINDS.get(method.name.rpartition(".")[2])
        if known is not None:
            return _repeated(known, kind, str(key))

        function = self._functions[method.name]

        def begin() -> Answer:
            return function(Call(session, owner, params, now_s, received_s))

        def named(answer: Answer) -> Answer:
            return answer if not isinstance(answer, Later) else self._named(answer.job, key, answer)

        running, if_busy = self._engine.jobs.running, params.get("if_busy", "reject")
        if running is not None and if_busy == "replace" and _is_own(running, owner):
            reason = Refusal("replaced", f"{method.name} of the same client replaced it")
            return named(self._engine.replace(reason, begin))
        if self._engine.jobs.running is not None and if_busy == "queue" and kind is not None:
            detached = is_detached(params)
            queued = self._engine.queue(kind, owner, detached, lambda: _job_of(begin()))
            return self._named(queued, key)
        return named(begin())

    def _named(self, job: Job | Refusal, key: str | None, answer: Later | None = None) -> Answer:
        if isinstance(job, Refusal):
            return job
        job.key = key if key is not None else job.key
        return answer or Later(job)


def _is_own(running: Job, owner: Owner) -> bool:
    """Whether a motion may be ended by who asks for another one."""
    same_lease = running.grant is not None and running.grant == owner.grant
    return same_lease or running.owner.client == owner.client


def _repeated(known: Job, kind: JobKind | None, key: str) -> Answer:
    if known.kind != kind:
        text = f"the key {key!r} names job {known.number}, {known.kind}: give this motion its own"
        return Refusal("invalid_params", text, {"parameter": "key", "job": known.number})
    return Later(known)


def _job_of(answer: Answer) -> Job | Refusal:
    """Return the job that a function has begun, once its turn had come."""
    if isinstance(answer, Later):
        return answer.job
    if isinstance(answer, Refusal):
        return answer
    return Refusal("internal_error", "a queued request began no motion")
