"""A follower in virtual time behind a leader that is a function of time; and the vendor's way.

The time is simulated, so the figures are the same on every machine.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bench.jaws.rig import DEFAULTS, PERIOD_S, TRAVEL_MM, Rig
from litegripd.control.limiter import DEFAULT_GAINS
from litegripd.control.motions.base import Action, PlainAction, Step
from litegripd.model.gripper import Geometry
from litegripd.model.motor import MitCommand, MotorView
from litegripd.model.teleop import (
    Arrival,
    LinkOptions,
    LinkStatus,
    TeleopFrame,
    TeleopSettings,
    decode_frame,
    encode_frame,
)
from litegripd.teleop.follower import Course, TeleopFollower
from litegripd.teleop.intake import MAX_FRAME_GAP_S

ON_ITS_WAY_S = 0.0005
"""What zenoh and two schedulers take on one machine or a quiet network."""
SEED_PERIOD_S = 0.02
SETTLE_S = 2.0
_SHIFTS = 60
_SHIFT_S = 0.0025

Motion = Callable[[float], float]
"""A leader's openness by time; until `SETTLE_S` it stands still."""


class ScriptedLeader:
    """A link over which a motion is heard, with a measurement's and the network's delay."""

    status = LinkStatus("open")

    def __init__(self, motion: Motion, began_s: float, every_s: float) -> None:
        self._motion = motion
        self._began_s = began_s
        self._every_s = every_s
        self._sent = 0

    def publish(self, _payload: bytes, _now_s: float) -> bool:
        return False

    def tell(self, _payload: bytes, _now_s: float) -> bool:
        return False

    def reply(self, _payload: bytes, _to: str, _now_s: float) -> bool:
        return False

    def receive(self, now_s: float) -> Sequence[Arrival]:
        """Return what was published by now: each frame tells of one period before it left."""
        arrived = []
        while (left_s := self._began_s + self._sent * self._every_s) + ON_ITS_WAY_S <= now_s:
            self._sent += 1
            measured_s = left_s - PERIOD_S
            openness = self._motion(measured_s - self._began_s)
            frame = encode_frame(TeleopFrame(openness, 0.0, 0.0, measured_s))
            arrived.append(Arrival(frame, left_s + ON_ITS_WAY_S))
        return arrived

    def close(self) -> None:
        pass


class VendorFollow(PlainAction):
    """A follower as the vendor's SDK describes it: 50 Hz, the target itself, dq by differencing.

    Nothing bounds its lead, and so its torque; it is begun where the leader is.
    """

    def __init__(self, geometry: Geometry, link: ScriptedLeader) -> None:
        self._geometry = geometry
        self._link = link
        self._command: MitCommand | None = None
        self._next_s = -math.inf
        self._last: tuple[float, float] | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        if motor.feedback is None:
            return Step()
        arrived = self._link.receive(now_s) if now_s >= self._next_s - 1e-6 else ()
        frame = decode_frame(arrived[-1].payload) if arrived else None
        if frame is not None:
            self._next_s = now_s + SEED_PERIOD_S
            geometry = self._geometry
            openness = min(max(frame.openness, 0.0), 1.0)
            target_rad = geometry.closed_rad - geometry.close_sign * openness * geometry.travel_rad
            self._command = DEFAULT_GAINS.at(target_rad, self._velocity_rad_s(now_s, target_rad))
        return Step(self._command or DEFAULT_GAINS.at(motor.feedback.position_rad))

    def _velocity_rad_s(self, now_s: float, target_rad: float) -> float:
        before, self._last = self._last, (now_s, target_rad)
        if before is None or not 0.0 < now_s - before[0] <= MAX_FRAME_GAP_S:
            return 0.0
        return min(max((target_rad - before[1]) / (now_s - before[0]), -10.0), 10.0)


@dataclass(frozen=True, slots=True)
class Way:
    """One way to follow."""

    name: str
    leader_every_s: float
    is_vendor: bool = False
    dq_max_rad_s: float = 10.0


WAYS = (
    Way("ours, 200 Hz", PERIOD_S),
    Way("ours, a 50 Hz leader", SEED_PERIOD_S),
    Way("ours, no feed-forward", PERIOD_S, dq_max_rad_s=0.0),
    Way("the SDK's, 50 Hz", SEED_PERIOD_S, is_vendor=True),
)


@dataclass(frozen=True, slots=True)
class Tracking:
    """How well a leader was followed; `lag_ms` is the shift in time that explains most of it."""

    lag_ms: float
    rms_mm: float
    worst_mm: float
    peak_nm: float


def follow(way: Way, motion: Motion, duration_s: float, object_mm: float | None = None) -> Tracking:
    """Follow a motion in virtual time."""
    rig = Rig("normal", motion(0.0) * TRAVEL_MM)
    rig.looks = 4
    if object_mm is not None:
        rig.gripper.put_object(width_mm=object_mm, stiffness_nm_rad=250.0)
    rig.run(0.5)
    began_s = rig.now_s + 1.0
    link = ScriptedLeader(motion, began_s, way.leader_every_s)
    rig.begin(action_of(way, rig.geometry, link))
    rig.run(began_s + SETTLE_S - rig.now_s)
    rig.peak_nm = 0.0
    leads: list[tuple[float, float]] = []
    for _ in range(round(duration_s / PERIOD_S)):
        rig.tick()
        leads.append((rig.now_s - began_s, rig.gripper.opening_mm))
    return judge(motion, rig.geometry.travel_mm, leads, rig.peak_nm)


def action_of(way: Way, geometry: Geometry, link: ScriptedLeader) -> Action:
    if way.is_vendor:
        return VendorFollow(geometry, link)
    settings = TeleopSettings(dq_max_rad_s=way.dq_max_rad_s)
    course = Course(geometry, DEFAULTS, DEFAULT_GAINS, settings, PERIOD_S)
    return TeleopFollower(link, LinkOptions("slave", "none"), lambda _event: None, course)


def judge(
    motion: Motion, travel_mm: float, seen: list[tuple[float, float]], peak_nm: float
) -> Tracking:
    def rms_mm(shift_s: float) -> float:
        squares = [(motion(at_s - shift_s) * travel_mm - mm) ** 2 for at_s, mm in seen]
        return math.sqrt(sum(squares) / len(squares))

    lag_s = min((number * _SHIFT_S for number in range(_SHIFTS)), key=rms_mm)
    worst_mm = max(abs(motion(at_s) * travel_mm - mm) for at_s, mm in seen)
    return Tracking(lag_s * 1e3, rms_mm(0.0), worst_mm, peak_nm)
