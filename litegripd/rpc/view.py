"""The forms that states, jobs and results have on the wire.

What is the same for many, such as the state of a tick, is encoded once and spliced in as it is.
"""

from dataclasses import fields
from typing import Any

from litegripd.model.jobs import Job, Owner
from litegripd.model.results import Progress, Result
from litegripd.model.state import GripperState
from litegripd.rpc.wire import RequestId, encode, error_object

_STATE_FIELDS = tuple(field.name for field in fields(GripperState))


def _plain(value: Any) -> dict[str, Any]:
    """Make a dict of a flat dataclass, field by field; `dataclasses.asdict` copies deeply."""
    return {field.name: getattr(value, field.name) for field in fields(value)}


def state_view(state: GripperState, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """Give a state its wire form, or only these fields of it, in this order."""
    view: dict[str, Any] = {name: getattr(state, name) for name in names or _STATE_FIELDS}
    if view.get("job") is not None:
        job = view["job"]
        owner = {"program": job.program, "pid": job.pid}
        view["job"] = {"job": job.job, "kind": job.kind, "phase": job.phase, "owner": owner}
    if view.get("stop") is not None:
        view["stop"] = _plain(view["stop"])
    return view


def owner_view(owner: Owner) -> dict[str, Any]:
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
    view = {
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
