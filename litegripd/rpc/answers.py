"""What the methods answer, as types: the functions make them, the OpenRPC document tells them.

What a motion ends with, the state and a job are declared in `litegripd.model`, the daemon's own
figures in `litegripd.rpc.facts`; `litegripd.rpc.reports` makes the forms of these.
"""

from collections.abc import Mapping
from typing import Any, Literal, TypedDict

from litegripd.model.geometry import Mount
from litegripd.model.jobs import Job, OnLost, StopLevel
from litegripd.model.results import ZeroResult
from litegripd.model.trajectory import Header, Summary
from litegripd.rpc.facts import MotionFields
from litegripd.rpc.reports import JobNumber, NumberedEvent, OwnerView, StateView
from litegripd.rpc.schema import Shape
from litegripd.rpc.sessions import Role

AT_ONCE = Shape("AtOnce", (JobNumber,), closed=True)
"""What a method answers that does not wait for the end of its job."""


# Reading


class Greeting(TypedDict):
    """What `hello` says of the connection that asks; the rest are the daemon's facts."""

    client: int
    role: Role
    monotonic_s: float
    stop_generation: int


Discovered = TypedDict(
    "Discovered",
    {
        "openrpc": str,
        "info": Mapping[str, object],
        "methods": list[Mapping[str, Any]],
        "x-notifications": list[Mapping[str, Any]],
        "components": Mapping[str, Mapping[str, Any]],
    },
)
"""The OpenRPC document."""


class ClientRow(TypedDict):
    """One connection."""

    client: int
    pid: int
    uid: int
    program: str
    role: Role
    connected_s: float
    requests: int
    refused: int
    bytes_in: int
    bytes_out: int
    dropped: int
    worst_latency_ms: float | None
    subscriptions: int
    waiting: int
    is_me: bool


class ClientList(TypedDict):
    """All connections."""

    clients: list[ClientRow]


class JobList(TypedDict):
    """The jobs that are kept."""

    jobs: list[Job]


class SubscriptionNumber(TypedDict):
    """The number of a subscription."""

    subscription: int


class StateSubscribed(SubscriptionNumber):
    """A subscription to the state, and what to begin with."""

    state: StateView


class EventsSubscribed(StateSubscribed):
    """A subscription to events, and what to begin with."""

    events: list[NumberedEvent]


# The lease


class Holder(OwnerView):
    """Who has the lease, and how."""

    purpose: str | None
    since_s: float
    ttl_s: float | None
    on_lost: OnLost
    number: int


class LeaseView(TypedDict):
    """Who has the lease."""

    owner: Holder | None
    mine: bool
    waiting: int


class LeaseNumber(TypedDict):
    """The number of a lease."""

    number: int


class Granted(LeaseNumber):
    """A lease, and the token by which it is shown."""

    lease: str
    state: StateView


class Taken(Granted):
    """A lease that was taken, and what became of what was."""

    taken_from: Holder | None
    ended_job: int | None
    jaws: OnLost | None


class Released(TypedDict):
    """That a lease was given back."""

    released: bool


# Stops


class Cleared(TypedDict):
    """The count of stops."""

    generation: int
    state: StateView


class Stopped(Cleared):
    """The stop that is latched now."""

    level: StopLevel


# Calibration, configuration, registers


class CalibrationView(TypedDict):
    """The calibration in use; `content` is that of its file, empty where there is none."""

    calibrated: bool
    mount: Mount | None
    closed_rad: float | None
    open_rad: float | None
    travel_rad: float | None
    travel_mm: float | None
    rad_to_mm: float | None
    kp: float
    kd: float
    file: str | None
    content: Mapping[str, object]


class CalibrationLoaded(CalibrationView):
    """The calibration in use now, and what was found."""

    loaded: bool
    factory: bool
    skipped: list[str]


class Template(TypedDict):
    """One template, and what its file holds."""

    name: str
    content: Mapping[str, object]


class Templates(TypedDict):
    """The templates of the mounts."""

    templates: list[Template]


class Marks(TypedDict):
    """What has been marked so far of a calibration by hand."""

    closed_rad: float | None
    open_rad: float | None


class Nothing(TypedDict):
    """An answer that only says that it is done."""


BY_HAND = (
    AT_ONCE,
    Shape("Marks", (Marks,), closed=True),
    Shape("Nothing", (Nothing,), closed=True),
    ZeroResult,
)
"""The answers to the steps of a calibration by hand."""


class RegisterValue(TypedDict):
    """What a register holds; null for what is no number."""

    number: int
    name: str
    value: float | None


class FrameInterval(TypedDict):
    """The daemon's period, which the SDK has among the fields of its configuration."""

    frame_interval: float


class ConfigView(TypedDict):
    """The motion configuration; `kept` says whether it outlives the daemon."""

    config: MotionFields
    ranges: Mapping[str, list[float]]
    kept: bool


# Trajectories


class NoTrajectory(TypedDict):
    """That nothing was recorded or played so far."""

    active: Literal[False]
    kind: None
    job: None
    samples: int
    error: None


class CaptureStatus(TypedDict):
    """How a recording goes, or how the last one went."""

    active: bool
    kind: Literal["record"]
    job: int | None
    samples: int
    error: str | None
    rate_hz: float
    zero_gravity: bool
    loop_hz: float | None
    missed: int
    duration_s: float
    max_samples: int


class ReplayStatus(TypedDict):
    """How a replay goes, or how the last one went."""

    active: bool
    kind: Literal["play"]
    job: int
    samples: int
    error: str | None
    frames: int
    speed: float
    openness: float | None
    completed: bool
    loops: int
    grips: int
    phase: str


class _Whole(TypedDict):
    """What a whole trajectory is kept as."""

    name: str | None
    path: str | None
    sha256: str
    total: int
    grips: int
    grip_problem: str | None


class _Recorded(TypedDict):
    """What only a recording has."""

    recording: int | None
    missed: int
    error: str | None
    grips_left_out: int


class _Complete(TypedDict):
    """What only the last piece of an upload has."""

    received: int
    complete: Literal[True]
    upload: int | None


class PieceTaken(TypedDict):
    """That a piece of an upload was taken, and others are still to come."""

    received: int
    complete: Literal[False]


RECORDED = Shape("TrajectoryRecorded", (_Recorded, _Whole, Header, Summary))
PUT = (PieceTaken, Shape("TrajectoryUploaded", (_Complete, _Whole, Header, Summary)))


class Listed(TypedDict):
    """One trajectory that is kept."""

    name: str
    error: None
    bytes: int
    samples: int
    sample_hz: float
    created_s: float
    mount: Mount | None
    duration_s: float | None
    grips: int
    grip_problem: str | None
    uid: int | None


class ListedBroken(TypedDict):
    """One that is kept, but cannot be used, and why."""

    name: str
    error: str
    uid: int | None


class TrajectoryUsage(TypedDict):
    """What one user has of the named trajectories, and may have."""

    uid: int
    named: int
    bytes: int
    most_named: int
    most_bytes: int


class TrajectoryList(TypedDict):
    """Some of the trajectories that are kept; `more` says whether others follow."""

    trajectories: list[Listed | ListedBroken]
    more: bool
    usage: TrajectoryUsage


class Piece(TypedDict):
    """A piece of a trajectory, base64."""

    data: str
    offset: int
    total: int
    sha256: str


class _Deleted(TypedDict):
    deleted: Literal[True]


class Deleted(_Deleted, total=False):
    """That a trajectory is gone; with its name, if it had one."""

    name: str
