"""Answers to those who wait for a job: its end, and its progress on the way."""

from litegripd.control.engine import Engine
from litegripd.model.errors import Refusal
from litegripd.rpc.reporter import Reporter
from litegripd.rpc.view import progress_view
from litegripd.rpc.waiting import Waiter, WaitingRoom
from litegripd.rpc.wire import encode, error_line, notification_line, result_line


class Answering:
    """Writes to the sessions of those who wait; a defect in one answer leaves the others."""

    def __init__(self, engine: Engine, reporter: Reporter, waiting: WaitingRoom) -> None:
        self._engine = engine
        self._reporter = reporter
        self._waiting = waiting

    def answer(self) -> None:
        """Answer the requests whose job has ended."""
        for waiter in self._waiting.take_ended():
            try:
                line = self._final_line(waiter)
            except Exception as error:  # noqa: BLE001 - the other waiters get their answers
                line = error_line(waiter.request, defect(waiter.job.kind, error))
            waiter.session.write(line)

    def send_progress(self, now_s: float) -> None:
        """Tell where the running job is, to who wants to know, when that is due."""
        job, progress = self._engine.jobs.running, self._engine.progress()
        if job is None or progress is None:
            return
        for waiter in self._waiting.due_progress(job.number, now_s):
            opening_mm = self._reporter.state().opening_mm
            view = progress_view(job, waiter.request, progress, opening_mm)
            waiter.session.write(notification_line("job.progress", encode(view)))

    def _final_line(self, waiter: Waiter) -> bytes:
        job = waiter.job
        if waiter.wants_job:
            return result_line(waiter.request, self._reporter.job(job))
        result = self._reporter.result(job)
        if result is None:
            ended = job.error or Refusal("internal_error", f"job {job.number} ended without result")
            return error_line(waiter.request, ended)
        return result_line(waiter.request, result)


def defect(what: str, error: Exception) -> Refusal:
    """Word what should not have happened, for who asked."""
    return Refusal("internal_error", f"{what} failed by a defect: {type(error).__name__}: {error}")
