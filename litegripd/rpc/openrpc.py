"""The OpenRPC document: methods, notifications and errors, and the form of each type in JSON."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NewType, TypedDict, get_args

from litegripd.control.authority import LossData
from litegripd.control.snapshot import GripperState, JobSummary
from litegripd.model.errors import ERROR_TABLE
from litegripd.model.motion_config import MotionConfig
from litegripd.model.state import Job, Progress, ReplayProgress, Result
from litegripd.motor.exchange import MotorCounters
from litegripd.rpc.jsonrpc import ErrorObject
from litegripd.rpc.method import AT_ONCE, WAIT, Method, Schema, Schemas, Shape
from litegripd.rpc.methods.reading import Discovered
from litegripd.rpc.methods.settings import FrameInterval
from litegripd.rpc.reports import (
    EndState,
    JobEnd,
    JobHead,
    JobNumber,
    JobSummaryView,
    MotionFields,
    MotorFigures,
    MotorUse,
    NumberedEvent,
    ProgressEnd,
    ProgressHead,
    StateView,
)
from litegripd.rpc.subscriptions import SubscriptionNumber

# Notifications ------------------------------------------------------------------------------------

PartialState = NewType("PartialState", dict[str, Any])
"""The wire form of a `GripperState`, or of the fields of it that a subscription names."""


class _Sample(SubscriptionNumber):
    seq: int
    dropped: int


class StateSample(_Sample):
    """One sample of the state."""

    monotonic_s: float
    state: PartialState


class StateBatch(_Sample):
    """Several samples: `rows` has of each the values of `fields`."""

    fields: list[str]
    rows: list[list[object]]


class Payload(TypedDict):
    """What is to be sent under a key of teleoperation, in hexadecimal digits."""

    topic: str
    payload: str


class Loser(TypedDict):
    """Who has lost the lease, or a motion without one."""

    client: int
    pid: int
    uid: int


@dataclass(frozen=True, slots=True)
class Notification:
    """One kind of notification: its purpose, and the type of its parameters."""

    name: str
    summary: str
    params: Any


NOTIFICATIONS: tuple[Notification, ...] = (
    Notification("state.sample", "A subscription to the state.", StateSample),
    Notification("state.batch", 'A subscription to the state with `"batch": n`.', StateBatch),
    Notification(
        "event",
        "A subscription to events.",
        Shape("EventNotification", (SubscriptionNumber, NumberedEvent)),
    ),
    Notification(
        "job.progress",
        'A motion that was asked for with `"progress": true`, at most 20 times a second.',
        Progress | ReplayProgress,
    ),
    Notification(
        "stream.refused",
        "A `stream.set` without an `id` that was refused. Only the first of several with the same"
        " reason is reported, and again after one that was taken.",
        ErrorObject,
    ),
    Notification(
        "teleop.send",
        "With `link` `client`: what the client that has begun teleoperation is to send over its own"
        " link. A client that does not read gets none meanwhile.",
        Payload,
    ),
    Notification(
        "teleop.refused",
        "A `teleop.receive` without an `id` that was refused; as `stream.refused`.",
        ErrorObject,
    ),
    Notification(
        "lease.lost",
        "The lease that this connection had is lost, or its motion without one, running or queued,"
        " was ended by a `lease.take`. Nobody has to subscribe to it.",
        Shape("LeaseLost", (Loser, LossData)),
    ),
)


# Forms --------------------------------------------------------------------------------------------

FORMS: Mapping[Any, Any] = {
    StateView: GripperState,
    PartialState: Shape("PartialState", (GripperState,), partial=True),
    JobSummary: JobSummaryView,
    Job: Shape("Job", (JobHead, JobEnd)),
    MotionFields: Shape("MotionFields", (MotionConfig, FrameInterval)),
    MotorFigures: Shape("MotorFigures", (MotorCounters, MotorUse)),
    **{
        kind: Shape(kind.__name__, (ProgressHead, kind, ProgressEnd))
        for kind in (Progress, ReplayProgress)
    },
    **{kind: Shape(kind.__name__, (JobNumber, kind, EndState)) for kind in get_args(Result)},
}
"""`litegripd.rpc.reports` makes most of them."""


# The document -------------------------------------------------------------------------------------

OPENRPC_VERSION = "1.2.6"
PROTOCOL_VERSION = 1


def document(methods: Iterable[Method]) -> Discovered:
    """Describe methods, with the limits of their rows, notifications and errors.

    OpenRPC has no word for unrequested messages of a server, nor for what must not be done late,
    after a stop (`x-stop-voids`): extensions of the document have.
    """
    schemas = Schemas(FORMS)
    return {
        "openrpc": OPENRPC_VERSION,
        "info": {"title": "litegripd", "version": str(PROTOCOL_VERSION)},
        "methods": [_method(row, schemas) for row in methods],
        "x-notifications": [
            {
                "name": kind.name,
                "summary": kind.summary,
                "params": {
                    "name": "params",
                    "schema": _titled(schemas.of(kind.params), _title(kind.name)),
                },
            }
            for kind in NOTIFICATIONS
        ],
        "components": {
            "schemas": {
                name: _titled(schema, _title(name)) for name, schema in schemas.definitions.items()
            },
            "errors": {
                kind.reason: {
                    "code": kind.code,
                    "message": kind.meaning,
                    "data": {"reason": kind.reason, "retryable": kind.retryable},
                }
                for kind in ERROR_TABLE
            },
        },
    }


def result_schema(method: Method, schemas: Schemas) -> Schema:
    """Describe the results of a method; one that does not have to wait has two."""
    schema = schemas.of(method.returns)
    if WAIT.name in method.declared:
        schema = {"anyOf": [schema, schemas.of(AT_ONCE)]}
    return {"type": "object", **schema}


def _method(method: Method, schemas: Schemas) -> dict[str, Any]:
    return {
        "name": method.name,
        "summary": method.summary,
        **({"x-stop-voids": True} if method.stop_voids else {}),
        "paramStructure": "by-name",
        "params": [
            {
                "name": param.name,
                "description": param.description,
                "required": param.required,
                "schema": _titled(param.json_schema(), _title(f"{method.name}.param.{param.name}")),
            }
            for param in method.declared.values()
        ],
        "result": {
            "name": "result",
            "description": method.result,
            "schema": _titled(result_schema(method, schemas), _title(f"{method.name}.result")),
        },
    }


def _title(name: str) -> str:
    """Return a name as types are written: `motion.grasp` is `MotionGrasp`."""
    return "".join(word[:1].upper() + word[1:] for word in re.split("[._-]", name))


def _titled(schema: Mapping[str, Any], title: str) -> Schema:
    """Return a schema with its title, and with titles of all in it that go on from there.

    Of these, programs that write clients make the names of types. What only refers has none: the
    schema that it refers to has.
    """
    if "$ref" in schema:
        return dict(schema)
    made: Schema = {"title": title, **schema}
    for key, ending in (("items", "Item"), ("additionalProperties", "Value")):
        if isinstance(made.get(key), Mapping):
            made[key] = _titled(made[key], title + ending)
    if "properties" in made:
        members = made["properties"].items()
        made["properties"] = {name: _titled(one, title + _title(name)) for name, one in members}
    if "anyOf" in made:
        made["anyOf"] = [
            _titled(one, f"{title}{number}") for number, one in enumerate(made["anyOf"], 1)
        ]
    return made
