"""Makes the wire forms of the present state and of jobs, each at most once per tick."""

from typing import Any

from litegripd.control.engine import Engine
from litegripd.control.snapshot import snapshot
from litegripd.model.jobs import Job
from litegripd.model.state import GripperState
from litegripd.rpc.view import job_view, result_view, state_view
from litegripd.rpc.wire import encode


class Reporter:
    """One encoding of the state per tick serves all who ask for it.

    A request may change the state between two ticks: `refresh` is called after each that can.
    """

    def __init__(self, engine: Engine, period_s: float) -> None:
        self._engine = engine
        self._period_s = period_s
        self._now_s = 0.0
        self._bus_is_up = False
        self._state: GripperState | None = None
        self._line: bytes | None = None
        self._ended_in: dict[int, GripperState] = {}

    def tick(self, now_s: float, bus_is_up: bool) -> None:
        """Begin a new period."""
        self._now_s = now_s
        self._bus_is_up = bus_is_up
        self.refresh()

    def refresh(self) -> None:
        """Make the state anew when it is next asked for."""
        self._state = None
        self._line = None

    def state(self) -> GripperState:
        """Return the present state."""
        if self._state is None:
            self._state = snapshot(self._engine, self._now_s, self._period_s, self._bus_is_up)
        return self._state

    def state_view(self) -> dict[str, Any]:
        """Return the present state in its wire form."""
        return state_view(self.state())

    def state_line(self) -> bytes:
        """Return the present state as JSON."""
        if self._line is None:
            self._line = encode(self.state_view())
        return self._line

    def job(self, job: Job) -> dict[str, Any]:
        """Return a job in its wire form."""
        if job.is_running:
            progress = self._engine.progress()
            return job_view(job, None if progress is None else progress.phase, None)
        return job_view(job, None, self._end_state(job))

    def result(self, job: Job) -> dict[str, Any] | None:
        """Return the result of a job that ended with one, in its wire form."""
        if job.result is None:
            return None
        return result_view(job, job.result, self._end_state(job))

    def _end_state(self, job: Job) -> GripperState:
        """Return the state in which a job ended, kept as long as the job itself."""
        if job.number not in self._ended_in:
            kept = {other.number for other in self._engine.jobs}
            self._ended_in = {n: s for n, s in self._ended_in.items() if n in kept}
            self._ended_in[job.number] = self.state()
        return self._ended_in[job.number]

    def keep_end_states(self) -> None:
        """Keep the state of every job that has ended in this period."""
        for job in self._engine.jobs:
            if not job.is_running and job.number not in self._ended_in:
                self._end_state(job)
