"""The forms that states, jobs and results have on the wire.

What is the same for many, such as the state of a tick, is encoded once and spliced in as it is.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NewType, TypedDict

from litegripd.model.events import EventKind
from litegripd.model.jobs import Job, JobKind, Owner
from litegripd.model.results import Progress, Result
from litegripd.model.state import GripperState, JobSummary
from litegripd.rpc.wire import ErrorObject, RequestId, encode, error_object

_STATE_FIELDS = tuple(field.name for field in fields(GripperState))

StateView = NewType("StateView", dict[str, Any])
"""The wire form of a `GripperState`, or of some of its fields."""


class JobNumber(TypedDict):
    """The number of a job."""

    job: int


class EndState(TypedDict):
    """The state in which a job ended."""

    state: StateView


class Program(TypedDict):
    """A process."""

    program: str
    pid: int


class OwnerView(Program):
    """Who asked for something: the number of a connection, and the process at its other end."""

    client: int
    uid: int


class JobSummaryView(JobNumber):
    """The running job, in brief."""

    kind: str
    phase: str | None
    owner: Program


class JobHead(JobNumber):
    """A job, but for its result; `state` is the value of a `JobState`."""

    kind: JobKind
    state: str
    owner: OwnerView
    detached: bool
    started_s: float
    ended_s: float | None
    phase: str | None
    error: ErrorObject | None


class JobEnd(TypedDict):
    """The result of a job."""

    result: Result | None


class NumberedEvent(TypedDict):
    """An event; `data` is other for each kind."""

    seq: int
    monotonic_s: float
    kind: EventKind
    message: str
    data: Mapping[str, object]


class ProgressHead(JobNumber):
    """Whose progress it is: the job's, and the id of the request that wants it."""

    request: str | int
    kind: JobKind


class ProgressEnd(TypedDict):
    """Where the jaws are, where that is known."""

    opening_mm: float | None


def _plain(value: Any) -> dict[str, Any]:
    """Make a dict of a flat dataclass, field by field; `dataclasses.asdict` copies deeply."""
    return {field.name: getattr(value, field.name) for field in fields(value)}


def state_view(state: GripperState, names: tuple[str, ...] = ()) -> StateView:
    """Give a state its wire form, or only these fields of it, in this order."""
    view: dict[str, Any] = {name: getattr(state, name) for name in names or _STATE_FIELDS}
    if view.get("job") is not None:
        view["job"] = _summary_view(view["job"])
    if view.get("stop") is not None:
        view["stop"] = _plain(view["stop"])
    return StateView(view)


def _summary_view(job: JobSummary) -> JobSummaryView:
    owner: Program = {"program": job.program, "pid": job.pid}
    return {"job": job.job, "kind": job.kind, "phase": job.phase, "owner": owner}


def owner_view(owner: Owner) -> OwnerView:
    """Give an owner its wire form."""
    return {
        "client": owner.client,
        "pid": owner.pid,
        "uid": owner.uid,
        "program": owner.program,
    }


def result_line(job: Job, result: Result, state: bytes) -> bytes:
    """Encode a job's result, with the encoded state in which the job ended."""
    return _with(encode({"job": job.number, **_plain(result)}), b"state", state)


def job_line(job: Job, phase: str | None, result: bytes | None) -> bytes:
    """Encode a job, with its encoded result, if it has one."""
    view: JobHead = {
        "job": job.number,
        "kind": job.kind,
        "state": job.state.value,
        "owner": owner_view(job.owner),
        "detached": job.detached,
        "started_s": job.started_s,
        "ended_s": job.ended_s,
        "phase": phase,
        "error": None if job.error is None else error_object(job.error),
    }
    return _with(encode(view), b"result", b"null" if result is None else result)


def _with(encoded: bytes, name: bytes, value: bytes) -> bytes:
    """Add a member, which is JSON already, to an encoded object that has others."""
    return b'%b,"%b":%b}' % (encoded[:-1], name, value)


def progress_view(
    job: Job, request: RequestId, progress: Progress, opening_mm: float | None
) -> dict[str, Any]:
    """Give a progress report its wire form; `request` is the id of the request that wants it."""
    return {
        "job": job.number,
        "request": request,
        "kind": job.kind,
        **_plain(progress),
        "opening_mm": opening_mm,
    }
