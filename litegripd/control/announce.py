"""The engine's events, worded: what the log tells a person about motions, stops and power."""

from litegripd.model.errors import Refusal
from litegripd.model.events import Event
from litegripd.model.jobs import Job, OnLost, Owner, StopLevel
from litegripd.model.motor import MotorPhase
from litegripd.model.results import Result

_ON_LOST_TEXT = {"hold": "keep their hold", "relax": "go slack", "disable": "are disabled"}


def job_started(job: Job) -> Event:
    """Tell who began what."""
    owner = job.owner
    text = f"job {job.number}: {job.kind} by {owner.program} (pid {owner.pid}, uid {owner.uid})"
    return Event("job_started", text, {"job": job.number, "kind": job.kind})


def job_ended(job: Job, outcome: Result | Refusal) -> Event:
    """Tell how a job ended."""
    how = outcome.message if isinstance(outcome, Refusal) else str(outcome)
    text = f"job {job.number}: {job.kind} {job.state.value}: {how}"
    return Event("job_ended", text, {"job": job.number, "state": job.state.value})


def stop_cleared(by: Owner) -> Event:
    """Tell who allowed motions again."""
    return Event("stop_cleared", f"stop cleared by {by.program} (pid {by.pid})")


def stopped(level: StopLevel, refusal: Refusal) -> Event:
    """Tell which stop is latched, in the words in which it refuses motions."""
    return Event("stop", refusal.message, {"level": level})


def client_lost(on_lost: OnLost, *, later: bool) -> Event:
    """Tell what becomes of the jaws of a lost client."""
    when = ", once the running motion has ended" if later else ""
    text = f"the client that had the gripper is gone: the jaws {_ON_LOST_TEXT[on_lost]}{when}"
    return Event("client_lost", text, {"on_lost": on_lost})


def motor_changed(before: MotorPhase, now: MotorPhase) -> Event:
    """Tell that the motor is in another phase."""
    return Event("motor", f"motor: {before.value} -> {now.value}", {"phase": now.value})
