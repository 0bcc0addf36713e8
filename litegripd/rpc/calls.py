"""One request on its way to its function, and the kinds of answer that a function may give."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, Owner
from litegripd.model.motion_config import MotionConfig, MotionConfigError
from litegripd.rpc.sessions import Session


def is_detached(params: Mapping[str, Any]) -> bool:
    """Whether a motion outlives its connection: as asked for, else if it is not waited for."""
    return bool(params.get("detach", not params.get("wait", True)))


@dataclass(frozen=True, slots=True)
class Call:
    """One request whose parameters have been checked; `received_s` is when its line came."""

    session: Session
    owner: Owner
    params: Mapping[str, Any]
    now_s: float
    received_s: float

    @property
    def detached(self) -> bool:
        """Whether the motion outlives its connection: as asked for, else if not waited for."""
        return is_detached(self.params)

    def config(self, base: MotionConfig, period_s: float) -> MotionConfig | Refusal:
        """Return `base` with what the caller wants to be otherwise, or why that cannot be."""
        given = self.params.get("config")
        if given is None:
            return base
        try:
            return base.changed(given, period_s)
        except MotionConfigError as error:
            data = {"parameter": "config", "field": error.field}
            return Refusal("invalid_params", f"config: {error}", data)


@dataclass(frozen=True, slots=True)
class Later:
    """The answer comes when `job` has ended: its result, or the job itself."""

    job: Job
    wants_job: bool = False


Result: TypeAlias = Mapping[str, Any] | bytes | Refusal


class Deferred:
    """The answer comes when somebody calls `resolve`, once."""

    def __init__(self) -> None:
        self._answer: Result | None = None
        self._on_answer: Callable[[Result], None] | None = None

    def resolve(self, answer: Result) -> None:
        """Give the answer."""
        self._answer = answer
        if self._on_answer is not None:
            self._on_answer(answer)

    def then(self, on_answer: Callable[[Result], None]) -> None:
        """Call `on_answer` with the answer, at once where it has been given already."""
        self._on_answer = on_answer
        if self._answer is not None:
            on_answer(self._answer)


Answer: TypeAlias = Result | Later | Deferred
"""A result at once, as a value or as JSON, a refusal, or an answer later."""

Function: TypeAlias = Callable[[Call], Answer]


def later(job: Job | Refusal) -> Answer:
    """Answer when a job has ended, if it has begun."""
    return job if isinstance(job, Refusal) else Later(job)
