"""What the daemon tells about itself; made by the room that knows all the others."""

from collections.abc import Mapping
from typing import Literal, NewType, Protocol, TypeAlias, TypedDict

from litegripd.model.geometry import Mount
from litegripd.model.motor import BusState
from litegripd.model.teleop import LinkState

Verdict: TypeAlias = Literal["ok", "degraded", "down"]


class MotorFacts(TypedDict):
    """The motor, as configured, and what it said of itself."""

    type: str
    can_id: int
    master_id: int | None
    serial: float | None


class GripperFacts(TypedDict):
    """The calibration in use, and the gains of a hold."""

    calibrated: bool
    mount: Mount | None
    travel_mm: float | None
    closed_rad: float | None
    open_rad: float | None
    rad_to_mm: float | None
    stroke_mm: float
    kp: float
    kd: float


class Limits(TypedDict):
    """What the daemon takes at most; `rate_hz` is its control rate."""

    rate_hz: float
    max_line_bytes: int
    max_connections: int
    max_connections_per_uid: int


class Hello(TypedDict):
    """The daemon, the motor and the limits."""

    daemon: str
    version: str
    protocol: int
    channel: str
    pid: int
    epoch: str
    simulated: bool
    stop_socket: str | None
    motor: MotorFacts
    gripper: GripperFacts
    limits: Limits


class CalibrationFacts(TypedDict):
    """Where the calibration came from; `saved_s` is the file's date, in Unix time."""

    file: str | None
    nominal: bool
    channel: str | None
    saved_s: float | None


class BusFacts(TypedDict):
    """The bus, as configured."""

    interface: str
    channel: str
    bitrate: int


class RpcFacts(TypedDict):
    """The socket, as configured."""

    group: str


class TrajectoryLimits(TypedDict):
    """How many named trajectories each user may have."""

    most_per_user: int
    most_mb_per_user: int


class Configuration(TypedDict):
    """What the daemon's configuration file says, or would."""

    file: str | None
    bus: BusFacts
    control: Mapping[str, object]
    rpc: RpcFacts
    trajectories: TrajectoryLimits


MotionFields = NewType("MotionFields", dict[str, float])
"""The wire form of a `MotionConfig`."""


class Info(Hello):
    """What does not change."""

    registers: Mapping[str, float | None]
    motor_warnings: list[str]
    calibration_file: str | None
    calibration: CalibrationFacts
    motion: MotionFields
    configuration: Configuration


class Durations(TypedDict):
    """How long something took: percentiles and the worst; null before the first."""

    p50_us: float | None
    p99_us: float | None
    p99_9_us: float | None
    worst_us: float | None


class ControlFigures(TypedDict):
    """How the control loop fares."""

    rate_hz: float
    ticks: int
    lost_ticks: int
    tick_errors: int
    lateness: Durations
    tick_cost: Durations
    cpu_share: float
    fifo_priority: int
    memory_locked: bool
    cpus: tuple[int, ...]
    longest_collection_us: float
    resident_mb: float


class BusFigures(TypedDict):
    """How the bus fares."""

    state: BusState
    error: str | None
    load: float
    sent: int
    received: int
    send_failures: int
    ignored: int
    error_frames: int
    errors: int
    reopened: int


MotorFigures = NewType("MotorFigures", dict[str, object])
"""The motor's counters, and whether somebody else commands it just now."""


class ForeignActive(TypedDict):
    """True if somebody else commands the motor just now."""

    foreign_active: bool


class HeatFigures(TypedDict):
    """The coil's temperature as the model has it; `allowed_nm` is null without a limit."""

    coil_c: float | None
    limit_c: float
    time_to_limit_s: float | None
    allowed_nm: float | None


class RpcFigures(TypedDict):
    """What the clients ask for."""

    clients: int
    requests: int
    refused_requests: int
    refused_connections: int
    budget_exhausted: int
    late_shares: int


class SpawnerFigures(TypedDict):
    """The process that starts the others."""

    pid: int | None
    is_running: bool
    deaths: int


class HelperFigures(TypedDict):
    """The process that reads and writes files."""

    pid: int | None
    deaths: int
    refused: int
    waiting: int


class LinkFigures(TypedDict):
    """The process of the teleoperation's link."""

    pid: int | None
    is_running: bool
    deaths: int
    link: LinkState | None
    open_to_network: bool | None


class LogFigures(TypedDict):
    """How the log fares."""

    dropped: int
    is_stuck: bool


class Figures(TypedDict):
    """The daemon's figures by their rooms."""

    uptime_s: float
    control: ControlFigures
    bus: BusFigures
    motor: MotorFigures
    heat: HeatFigures
    rpc: RpcFigures
    spawner: SpawnerFigures
    helper: HelperFigures
    teleop: LinkFigures
    log: LogFigures


class Judged(TypedDict):
    """How the daemon fares, and why not better."""

    verdict: Verdict
    reasons: list[str]


class Facts(Protocol):
    """What JSON can hold."""

    def hello(self) -> Mapping[str, object]:
        """Return what `Hello` declares."""

    def health(self, now_s: float) -> Mapping[str, object]:
        """Return what `Judged` and `Figures` declare; no figures before the daemon has started."""

    def info(self) -> Mapping[str, object]:
        """Return what `Info` declares."""
