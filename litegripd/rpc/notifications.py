"""The table of notifications: what the daemon sends without a request, and the forms of it."""

from dataclasses import dataclass
from typing import Any, NewType, TypedDict

from litegripd.control.lease import LossData
from litegripd.model.results import Progress, ReplayProgress
from litegripd.rpc.answers import SubscriptionNumber
from litegripd.rpc.type_schema import Shape
from litegripd.rpc.view import NumberedEvent
from litegripd.rpc.wire import ErrorObject

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


class Loser(TypedDict):
    """Who has lost the lease."""

    client: int
    pid: int
    uid: int


@dataclass(frozen=True, slots=True)
class Notification:
    """One kind of notification: what it is for, and the type of its parameters."""

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
        " reason is told, and again after one that was taken.",
        ErrorObject,
    ),
    Notification(
        "lease.lost",
        "The lease that this connection had is lost. Nobody has to subscribe to it.",
        Shape("LeaseLost", (Loser, LossData)),
    ),
)
