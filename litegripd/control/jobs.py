"""The jobs: at most one runs; those that ended are kept for a while, for clients that come back."""

from collections import OrderedDict
from collections.abc import Iterator

from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, JobKind, JobState, Owner
from litegripd.model.results import Result

KEPT_JOBS = 64

_CANCELLED_BY = frozenset({"cancelled", "client_lost", "stopped"})


class JobBook:
    """Numbers the jobs, knows the running one and keeps the last `KEPT_JOBS`."""

    def __init__(self) -> None:
        self.running: Job | None = None
        self._jobs: OrderedDict[int, Job] = OrderedDict()
        self._last = 0

    def __iter__(self) -> Iterator[Job]:
        """Iterate over what is kept, the oldest first."""
        return iter(self._jobs.values())

    def get(self, number: int) -> Job | None:
        """Return a job that is still kept."""
        return self._jobs.get(number)

    def begin(self, kind: JobKind, owner: Owner, detached: bool, now_s: float) -> Job:
        """Make a new job the running one; the caller has made sure that none is running."""
        self._last += 1
        job = Job(self._last, kind, owner, detached, now_s)
        self._jobs[job.number] = job
        while len(self._jobs) > KEPT_JOBS:
            self._jobs.popitem(last=False)
        self.running = job
        return job

    def end(self, outcome: Result | Refusal, now_s: float) -> Job | None:
        """End the running job with a result, or with the reason why it could not go on."""
        job, self.running = self.running, None
        if job is None:
            return None
        job.ended_s = now_s
        if isinstance(outcome, Refusal):
            job.error = outcome
            cancelled = outcome.reason in _CANCELLED_BY
            job.state = JobState.CANCELLED if cancelled else JobState.FAILED
        else:
            job.result = outcome
            job.state = JobState.DONE
        return job
