"""What happened in the gripper, as values: the log is written from them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

EventKind: TypeAlias = Literal[
    "job_started",
    "job_ended",
    "stop",
    "stop_cleared",
    "bus",
    "motor",
    "second_master",
    "implausible",
    "client_lost",
    "object_lost",
    "object_moved",
    "heat",
    "calibration",
    "lease",
    "lease_lost",
    "recorder",
    "refused",
    "teleop",
]


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened: a sentence for a person, and the same for a program."""

    kind: EventKind
    message: str
    data: Mapping[str, object] = field(default_factory=dict)
