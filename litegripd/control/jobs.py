"""The jobs, of which at most one runs, and the registers that clients read beside them.

Jobs that ended are kept for a while, for clients that come back.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.motor import RegisterReply, RegisterRequest
from litegripd.model.plain import Carried
from litegripd.model.results import Result
from litegripd.model.state import Job, JobKind, JobState, Owner

KEPT_JOBS = 64

MOST_QUEUED = 8

_CANCELLED_BY = frozenset({"cancelled", "client_lost", "lease_lost", "replaced", "stopped"})


Start: TypeAlias = Callable[[], Job | Refusal]
"""Asks for a motion again, as its request did; by now it may be rejected."""


@dataclass(frozen=True, slots=True)
class QueuedJob:
    """A job that waits for the end of the running one, and the function that starts it then."""

    job: Job
    start: Start


class JobBook:
    """Numbers the jobs, knows the running and the waiting ones, and keeps the last `KEPT_JOBS`.

    A queued job has a number, too; the controller starts it.
    """

    _last: Carried[int] = 0
    NOT_CARRIED = ("running", "queue", "_jobs", "_ended")  # `_jobs` follows later, by `keep`

    def __init__(self) -> None:
        self.running: Job | None = None
        self.queue: deque[QueuedJob] = deque()
        self._jobs: OrderedDict[int, Job] = OrderedDict()
        self._ended: list[Job] = []

    def __iter__(self) -> Iterator[Job]:
        """Iterate over the kept jobs, the oldest first."""
        return iter(self._jobs.values())

    def get(self, number: int) -> Job | None:
        """Return a kept job, or None."""
        return self._jobs.get(number)

    def latest(self, *kinds: JobKind) -> Job | None:
        """Return the kept job of these kinds that began last."""
        begun = (job for job in self if job.kind in kinds and job.state is not JobState.QUEUED)
        return max(begun, key=lambda job: (job.started_s, job.number), default=None)

    def find(self, owner: Owner, key: str) -> Job | None:
        """Return the kept job to which the same program gave this key."""
        jobs = (job for job in self if job.key == key and _is_same_program(job.owner, owner))
        return next(jobs, None)

    def keep(self, jobs: Iterable[Job]) -> None:
        """Keep ended jobs of a predecessor."""
        self._jobs.update((job.number, job) for job in jobs)

    def add(self, kind: JobKind, owner: Owner, detached: bool, now_s: float) -> Job:
        """Return a new job, which waits for its turn."""
        self._last += 1
        job = Job(self._last, kind, owner, detached, now_s, JobState.QUEUED)
        self._jobs[job.number] = job
        while len(self._jobs) > KEPT_JOBS:
            oldest = next(number for number, kept in self._jobs.items() if not kept.is_running)
            del self._jobs[oldest]
        return job

    def enqueue(
        self, kind: JobKind, owner: Owner, detached: bool, now_s: float, start: Start
    ) -> Job | Refusal:
        """Let a motion wait for its turn; return a refusal if `MOST_QUEUED` wait already."""
        if len(self.queue) >= MOST_QUEUED:
            text = f"{MOST_QUEUED} motions wait for their turn already"
            return Refusal("too_many_requests", text, {"limit": MOST_QUEUED})
        job = self.add(kind, owner, detached, now_s)
        self.queue.append(QueuedJob(job, start))
        return job

    def take_queued(self, which: Callable[[Job], bool]) -> list[Job]:
        """Take jobs out of the queue, the oldest first, and return them."""
        taken = [entry.job for entry in self.queue if which(entry.job)]
        self.queue = deque(entry for entry in self.queue if entry.job not in taken)
        return taken

    def begin(self, job: Job, now_s: float) -> None:
        """Make a job the running one; the caller has checked that none is running."""
        job.state, job.started_s = JobState.RUNNING, now_s
        self.running = job

    def end(self, job: Job, outcome: Result | Refusal, now_s: float) -> None:
        """End a job with a result, or with the reason why it could not continue."""
        if job is self.running:
            self.running = None
        job.ended_s = now_s
        self._ended.append(job)
        if isinstance(outcome, Refusal):
            job.error = outcome
            cancelled = outcome.reason in _CANCELLED_BY
            job.state = JobState.CANCELLED if cancelled else JobState.FAILED
        else:
            job.result = outcome
            job.state = JobState.DONE

    def take_ended(self) -> list[Job]:
        """Return the jobs that have ended since the last call."""
        ended, self._ended = self._ended, []
        return ended


def _is_same_program(one: Owner, other: Owner) -> bool:
    """Return True if two requests are of one process, perhaps by two connections.

    Processes of another pid namespace have no number here (pid 0), so only their connections
    distinguish them.
    """
    if one.pid == 0 or other.pid == 0:
        return one.client == other.client
    return (one.pid, one.uid) == (other.pid, other.uid)


MOST_WAITING = 16

OnReply: TypeAlias = Callable[[RegisterReply], None]


@dataclass(frozen=True, slots=True)
class _RegisterRead:
    request: RegisterRequest
    on_reply: OnReply


class RegisterReads:
    """The queue of registers to be read."""

    def __init__(self) -> None:
        self._row: deque[_RegisterRead] = deque()
        self._last = 0

    def add(self, number: int, on_reply: OnReply) -> Refusal | None:
        """Add a register to the queue; `on_reply` is called once, in a tick."""
        if len(self._row) >= MOST_WAITING:
            text = f"{MOST_WAITING} registers are waiting to be read already: try again"
            return Refusal("too_many_requests", text, {"limit": MOST_WAITING})
        self._last += 1
        self._row.append(_RegisterRead(RegisterRequest(self._last, number), on_reply))
        return None

    def step(self, reply: RegisterReply | None) -> RegisterRequest | None:
        """Pass on the motor's latest reply; return the register to ask for now."""
        row = self._row
        if row and reply is not None and reply.identity == row[0].request.identity:
            row.popleft().on_reply(reply)
        return row[0].request if row else None
