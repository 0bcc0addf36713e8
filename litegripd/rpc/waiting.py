"""Requests whose answer comes when a job has ended, and those that want its progress."""

from collections.abc import Iterator
from dataclasses import dataclass

from litegripd.model.jobs import Job
from litegripd.rpc.session import Session
from litegripd.rpc.wire import RequestId

MAX_PER_SESSION = 32
PROGRESS_INTERVAL_S = 0.05  # 20 Hz


@dataclass(frozen=True, slots=True)
class Waiter:
    """One unanswered request: for the job's result, or for the job itself (`job.wait`)."""

    session: Session
    request: RequestId
    job: Job
    wants_job: bool
    wants_progress: bool


class WaitingRoom:
    """The unanswered requests by the number of the job that they wait for."""

    def __init__(self) -> None:
        self._waiters: dict[int, list[Waiter]] = {}
        self._next_progress_s = 0.0

    def add(self, waiter: Waiter) -> None:
        """Let a request wait."""
        waiter.session.unanswered += 1
        self._waiters.setdefault(waiter.job.number, []).append(waiter)

    def take_ended(self) -> Iterator[Waiter]:
        """Yield, and forget, the requests whose job has ended, each before it is answered."""
        for number, waiters in list(self._waiters.items()):
            if not waiters[0].job.is_running:
                del self._waiters[number]
                for waiter in waiters:
                    waiter.session.unanswered -= 1
                    yield waiter

    def remove_all(self, session: Session) -> None:
        """Forget the requests of a client that is gone."""
        for job, waiters in list(self._waiters.items()):
            kept = [waiter for waiter in waiters if waiter.session is not session]
            if kept:
                self._waiters[job] = kept
            else:
                del self._waiters[job]

    def due_progress(self, job: int, now_s: float) -> list[Waiter]:
        """Return who is to be told the progress of `job` now; nobody who has not read the last."""
        if job not in self._waiters or now_s < self._next_progress_s:
            return []
        self._next_progress_s = now_s + PROGRESS_INTERVAL_S
        return [w for w in self._waiters[job] if w.wants_progress and not w.session.congested]
