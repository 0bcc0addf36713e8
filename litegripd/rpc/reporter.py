"""Makes the wire forms of the present state and of jobs, each at most once per tick."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from litegripd.control.engine import Engine
from litegripd.control.jobs import KEPT_JOBS
from litegripd.control.snapshot import snapshot
from litegripd.model.jobs import Job
from litegripd.model.state import GripperState
from litegripd.rpc.view import StateView, job_line, result_line, state_view
from litegripd.rpc.wire import encode


@dataclass(frozen=True, slots=True)
class _End:
    """A job that has ended, and its result, as JSON: 64 of them are listed in one answer."""

    job: bytes
    result: bytes | None


class Reporter:
    """One encoding of the state per tick serves all who ask for it.

    A request may change the state between two ticks: `refresh` is called after each that can.
    """

    def __init__(self, engine: Engine, period_s: float) -> None:
        self._engine = engine
        self._period_s = period_s
        self._now_s = 0.0
        self._state: GripperState | None = None
        self._line: bytes | None = None
        self._ends: dict[int, _End] = {}

    @property
    def rate_hz(self) -> float:
        """How often the state is new."""
        return round(1.0 / self._period_s, 6)

    def tick(self, now_s: float) -> None:
        """Begin a new period."""
        self._now_s = now_s
        self.refresh()

    def refresh(self) -> None:
        """Make the state anew when it is next asked for."""
        self._state = None
        self._line = None

    def state(self) -> GripperState:
        """Return the present state."""
        if self._state is None:
            self._state = snapshot(self._engine, self._now_s, self._period_s)
        return self._state

    def state_view(self) -> StateView:
        """Return the present state in its wire form."""
        return state_view(self.state())

    def state_line(self) -> bytes:
        """Return the present state as JSON."""
        if self._line is None:
            self._line = encode(self.state_view())
        return self._line

    def job(self, job: Job) -> bytes:
        """Return a job as JSON; one that has ended with the state in which it ended."""
        if job.is_running:
            progress = self._engine.progress() if job is self._engine.jobs.running else None
            return job_line(job, None if progress is None else progress.phase, None)
        return self._end_of(job).job

    def result(self, job: Job) -> bytes | None:
        """Return the result of a job that ended with one, as JSON."""
        return self._end_of(job).result

    def keep_ends(self) -> None:
        """Encode every job that has ended in this period, and forget those no longer kept."""
        for job in self._engine.jobs.take_ended():
            self._end_of(job)
        if len(self._ends) > 2 * KEPT_JOBS:
            kept = {job.number for job in self._engine.jobs}
            self._ends = {number: end for number, end in self._ends.items() if number in kept}

    def memory(self) -> dict[str, list[str | None]]:
        """Return what is kept of the jobs that have ended, as JSON can hold it."""
        return {
            str(number): [end.job.decode(), None if end.result is None else end.result.decode()]
            for number, end in self._ends.items()
        }

    def restore(self, plain: Mapping[str, Sequence[str | None]]) -> None:
        """Keep what `memory` has returned in a predecessor."""
        for number, (job, result) in plain.items():
            encoded = None if result is None else result.encode()
            self._ends[int(number)] = _End((job or "").encode(), encoded)

    def _end_of(self, job: Job) -> _End:
        end = self._ends.get(job.number)
        if end is None:
            result = None if job.result is None else result_line(job, job.result, self.state_line())
            end = self._ends[job.number] = _End(job_line(job, None, result), result)
        return end
