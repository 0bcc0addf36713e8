"""Values of teleoperation: its options, its links, and the frames on the wire.

A leader's frame has 32 bytes, which other stacks send and read, too: four big-endian float64 with
openness, position, force and the sender's time. Nothing is clamped here: a frame with a value that
is no number is rejected. So is one whose openness or position is subnormal. No measurement is that
small, but a double in the other byte order looks like that, and would close the jaws.

A follower's frame, 40 bytes of our own, carries the force at its jaws to the leader's hand. It has
its own key, and a length and a mark that no leader's frame has, so neither can be mistaken for the
other.

A follower's ready frame is one byte on a key of its own, as other stacks send and read it: 0 for
not ready, anything else for ready.
"""

import math
import re
import struct
import sys
from dataclasses import dataclass
from typing import Literal, TypeAlias

TeleopMode: TypeAlias = Literal["master", "slave"]
LinkKind: TypeAlias = Literal["zenoh", "udp", "client", "none"]

DEFAULT_PORT = 17448
DEFAULT_GRIP_ID = "gripA"
DEFAULT_WATCHDOG_S = 0.2
DEFAULT_DQ_MAX_RAD_S = 10.0
DEFAULT_READY_TIMEOUT_S = 10.0
DEFAULT_READY_TOLERANCE_MM = 2.0
DEFAULT_READY_PERIOD_S = 0.1
DEFAULT_REFLECT_GAIN = 0.5
"""The vendor's defaults. The two ends of a link must share those that matter to both. The vendor
has no reflection, so the last one is ours."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """The link to open. `host` is the other end's: a follower's leader, or the receiver of UDP.

    `bind` is the address at which a follower over UDP listens, None for all. With "client" the
    client that has begun teleoperation carries the bytes.

    A leader sends UDP to one address or several (see `udp_targets`). With `reflects` the followers'
    forces travel the other way.
    """

    mode: TeleopMode
    kind: LinkKind = "zenoh"
    host: str | None = None
    port: int = DEFAULT_PORT
    grip_id: str = DEFAULT_GRIP_ID
    reflects: bool = False
    bind: str | None = None

    @property
    def topic(self) -> str:
        """The key under which frames travel; UDP has none, but uses the same name."""
        return f"litearm/v4/{self.grip_id}/gripper_teleop"

    @property
    def force_topic(self) -> str:
        """The key under which followers report their force; no other stack uses it."""
        return f"{self.topic}_force"

    @property
    def ready_topic(self) -> str:
        """The key under which a follower says whether it is ready."""
        return f"litearm/v4/{self.grip_id}/gripper_ready"

    @property
    def has_ready(self) -> bool:
        """True if a follower's ready frames can reach a leader: over UDP they have no way."""
        return self.kind in ("zenoh", "client")


@dataclass(frozen=True, slots=True)
class Arrival:
    """A frame as it came over a link: at `at_s` of the receiver's clock, from `source`.

    `source` distinguishes senders if the transport can do so; otherwise it is empty.
    """

    payload: bytes
    at_s: float
    source: str = ""


LinkState: TypeAlias = Literal["opening", "open", "failed"]


ReachState: TypeAlias = Literal[
    "resolving", "connecting", "connected", "bound", "sending", "frames"
]
"""Over zenoh a follower resolves, connects and is connected. Over UDP, which has no connections, a
follower is bound and a leader sends. `frames`: they come."""


@dataclass(frozen=True, slots=True)
class Reach:
    """How far an end has come on the way to the other one.

    `why` says what is in the way, since `since_s` (CLOCK_MONOTONIC); None while nothing is known
    to be.
    """

    state: ReachState
    why: str | None = None
    since_s: float | None = None

    def problem(self, now_s: float) -> str | None:
        """Return what is in the way, and for how long, or None."""
        if self.why is None:
            return None
        for_s = 0.0 if self.since_s is None else max(now_s - self.since_s, 0.0)
        return f"{self.why} (for {for_s:.0f} s)"


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """The state of a link: `error` says why it failed (it is retried automatically).

    `matching` is True if another end listens to a leader, None if nobody can know; `dropped` counts
    what came faster than any leader sends, or from an unexpected sender. `is_protected` is True if
    only ends that the configuration names can take part, None before it is open, and where only a
    client knows. `reach` is how far this end has come to the other one, None of an end that cannot
    know.
    """

    state: LinkState = "opening"
    error: str | None = None
    matching: bool | None = None
    dropped: int = 0
    is_protected: bool | None = None
    reach: Reach | None = None


@dataclass(frozen=True, slots=True)
class TeleopSettings:
    """How to lead or to follow.

    `rate_hz` is the leader's; None means every tick. `torque_limit_nm` 0 turns the guard off. With
    `force_limit_n` None a follower eases to the torque of a press; `MOST_PUSH_NM` bounds it in any
    case. Gains that are None are the calibration's.
    A leader pushes back with the share `reflect_gain` of its followers' force, `reflect_n` at most.
    With `require_ready` its jaws hold until a follower is ready, `ready_timeout_s` at most (0: for
    ever). A follower is ready while its jaws are within `ready_tolerance_mm` of where it follows
    to, and says so every `ready_period_s`. Without `align` it follows at once, wherever its leader
    is.
    """

    rate_hz: float | None = None
    watchdog_s: float = DEFAULT_WATCHDOG_S
    torque_limit_nm: float = 0.0
    force_limit_n: float | None = None
    kp_nm_rad: float | None = None
    kd_nm_s_rad: float | None = None
    dq_max_rad_s: float = DEFAULT_DQ_MAX_RAD_S
    reflect_n: float = 0.0
    reflect_gain: float = DEFAULT_REFLECT_GAIN
    require_ready: bool = True
    ready_timeout_s: float = DEFAULT_READY_TIMEOUT_S
    ready_tolerance_mm: float = DEFAULT_READY_TOLERANCE_MM
    ready_period_s: float = DEFAULT_READY_PERIOD_S
    align: bool = True


@dataclass(frozen=True, slots=True)
class TeleopStatus:
    """How teleoperation is going; names as in the vendor's SDK, and some more.

    `openness`, `position_mm` and `force_n` are a master's own; a slave that follows has its
    leader's; they are 0 while `frames` is 0. `torque_nm` is this gripper's own torque. `frames`
    counts those sent, or followed.
    `rejected` counts what was no frame, `out_of_order` frames that were older than one before,
    `other_leaders` those of a second leader, or of a clock that was set back; all are dropped.
    `send_failed` counts frames that could not be sent, or, of a slave, ticks whose command the
    motor did not answer. `fault` names the motor's status if it is not "enabled", or why everything
    ended; else it is empty.

    `ready` is what a slave says of itself: it follows, and its jaws are where the leader's are. At
    a master it is true once a slave has said so: from then on the jaws are slack, until the end.
    `ready_rx` counts what a master has heard of that, `ready_pubs` what a slave has sent.
    `ready_timed_out` is true if a master's jaws went slack though nobody was ready in time.

    `host` and `port` are the link's: where a slave's leader is, with UDP also where a master sends
    to; None without a network. `link_protected` is False if anyone who reaches the link can take
    part; like `link_state` and `matching` it is None after the end. `link_reach` is how far a slave
    has come to its leader, or a master over UDP to its followers, and `link_unreached` what is in
    the way. `force_limited` is
    True if a slave would press harder without its limits. With force reflection `reflected_n` is
    what a slave has last reported to its leader (squeezing positive; None while it reports none),
    or how hard a master's jaws push now (opening positive). `followers` counts those whose force a
    master receives, `round_trip_ms` is the age of the position that the newest force answers.
    `late` counts frames that lay in the network while it was silent, or, of a master, forces that
    came too late.
    """

    active: bool
    mode: TeleopMode | None = None
    phase: str | None = None
    topic: str | None = None
    link: LinkKind | None = None
    host: str | None = None
    port: int | None = None
    link_state: LinkState | None = None
    link_error: str | None = None
    link_protected: bool | None = None
    link_reach: ReachState | None = None
    link_unreached: str | None = None
    matching: bool | None = None
    frames: int = 0
    last_frame_age_ms: float | None = None
    stale: bool = False
    openness: float = 0.0
    position_mm: float = 0.0
    force_n: float = 0.0
    dq_cmd: float = 0.0
    loop_hz: float = 0.0
    rejected: int = 0
    out_of_order: int = 0
    other_leaders: int = 0
    dropped: int = 0
    send_failed: int = 0
    fault: str = ""
    torque_nm: float = 0.0
    over_torque: bool = False
    torque_trips: int = 0
    ready: bool = False
    ready_rx: int = 0
    ready_pubs: int = 0
    ready_timed_out: bool = False
    force_limited: bool = False
    reflects: bool = False
    reflected_n: float | None = None
    followers: int | None = None
    round_trip_ms: float | None = None
    late: int = 0
    job: int | None = None


MOST_TARGETS = 8
_TARGET = re.compile(r"(\[[^\[\]]+\]|[^:\[\]]+)(?::(\d{1,5}))?")


def udp_targets(options: LinkOptions) -> tuple[tuple[str, int], ...]:
    """Return the hosts and ports that a leader sends to.

    `host` names them, separated by commas, each with its own port if that is not the link's:
    `10.0.0.2,10.0.0.3:17449`, `[fe80::1]:17449`. Raises `ValueError` for an invalid port or name,
    and for more than `MOST_TARGETS`.
    """
    names = [name.strip() for name in (options.host or "").split(",")]
    if len(names) > MOST_TARGETS:
        raise ValueError(f"names {len(names)} followers, {MOST_TARGETS} are the most")
    return tuple(_target(name, options.port) for name in names)


def _target(name: str, port: int) -> tuple[str, int]:
    if name.count(":") > 1 and not name.startswith("["):
        return name, port  # a plain IPv6 address
    found = _TARGET.fullmatch(name)
    if found is None:
        raise ValueError(f"has {name!r}, which is neither HOST nor HOST:PORT nor [IPV6]:PORT")
    host = found[1].removeprefix("[").removesuffix("]")
    own_port = port if found[2] is None else int(found[2])
    if not 1 <= own_port <= 65_535:
        raise ValueError(f"has the port {own_port}, it must be 1 to 65535")
    return host, own_port


_FRAME = struct.Struct(">4d")
FRAME_BYTES = _FRAME.size


@dataclass(frozen=True, slots=True)
class TeleopFrame:
    """What a leader reports of itself.

    `openness` is 0 (closed) to 1 (open), `position_mm` its opening, `force_n` its force, squeezing
    positive. `timestamp_s` is of the sender's own clock: two machines share none, so only
    differences of one sender's times mean something.
    """

    openness: float
    position_mm: float
    force_n: float
    timestamp_s: float


def encode_frame(frame: TeleopFrame) -> bytes:
    """Return the 32 bytes; raises `ValueError` for a value that is not finite."""
    values = (frame.openness, frame.position_mm, frame.force_n, frame.timestamp_s)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"a teleoperation frame needs finite values, not {values}")
    return _FRAME.pack(*values)


def decode_frame(payload: bytes) -> TeleopFrame | None:
    """Return the frame, or None for another length, a value that is not finite or a subnormal one.

    Only openness and position count as subnormal. A force may come from a filter that decays, and
    nobody follows it. A frame with an openness beyond 0 to 1 is valid: a follower keeps to its own
    travel.
    """
    if len(payload) != FRAME_BYTES:
        return None
    values = _FRAME.unpack(payload)
    if not all(map(math.isfinite, values)) or any(map(_is_subnormal, values[:2])):
        return None
    return TeleopFrame(*values)


def _is_subnormal(value: float) -> bool:
    return 0.0 < abs(value) < sys.float_info.min


READY_FRAME_BYTES = 1


def encode_ready(is_ready: bool) -> bytes:
    """Return the one byte."""
    return bytes([is_ready])


def decode_ready(payload: bytes) -> bool | None:
    """Return True for any byte but 0, or None for another length."""
    return any(payload) if len(payload) == READY_FRAME_BYTES else None


MAGIC = b"LGFORCE1"
_FORCE_FRAME = struct.Struct(">8sQ3d")
FORCE_FRAME_BYTES = _FORCE_FRAME.size
LARGEST_SENDER = 2**64 - 1


@dataclass(frozen=True, slots=True)
class ForceFrame:
    """What a follower reports of itself.

    `sender` is a number of its own, 0 to 2^64 - 1. `force_n` is the force at its jaws, squeezing
    positive. `timestamp_s` is of its own clock. `echo_s` is the timestamp of the leader's frame
    that it followed last, of the leader's clock: only by this the leader knows how old the answered
    position is.
    """

    sender: int
    force_n: float
    timestamp_s: float
    echo_s: float


def encode_force(frame: ForceFrame) -> bytes:
    """Return the 40 bytes; raises `ValueError` for a value that is not finite or no sender."""
    values = (frame.force_n, frame.timestamp_s, frame.echo_s)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"a force frame needs finite values, not {values}")
    if not 0 <= frame.sender <= LARGEST_SENDER:
        raise ValueError(f"a sender is 0 to 2^64 - 1, not {frame.sender}")
    return _FORCE_FRAME.pack(MAGIC, frame.sender, *values)


def decode_force(payload: bytes) -> ForceFrame | None:
    """Return the frame, or None for another length or mark, or a value that is not finite."""
    if len(payload) != FORCE_FRAME_BYTES:
        return None
    magic, sender, *values = _FORCE_FRAME.unpack(payload)
    if magic != MAGIC or not all(map(math.isfinite, values)):
        return None
    return ForceFrame(sender, *values)
