"""Scenes of leader and follower in virtual time: two grippers, or one and frames by a script.

The frames of a script are packed by `struct` alone, as the facts describe them.
"""

import math
import random
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from litegripd.app.build import build_service
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.motion_config import MOVING_KP_NM_RAD, MotionConfig
from litegripd.model.teleop import Arrival, LinkOptions, LinkStatus
from litegripd.sim.plant import MOUNTS
from tests.world import PERIOD_S, Client, FixedFacts, World

MM_RAD = NOMINAL[0].rad_to_mm
CODE_RAD = 25.0 / 65535
TRAVEL_MM = NOMINAL[0].travel_mm
HALF_MM, OBJECT_MM = TRAVEL_MM / 2.0, TRAVEL_MM * 5.0 / 12.0
"""Where a follower begins, and what is a little less wide."""
MAX_LEAD_RAD = MotionConfig().travel_nm / MOVING_KP_NM_RAD
STOP_LEAD_RAD = MotionConfig().stop_nm / MOVING_KP_NM_RAD
"""The largest leads with the usual stiffness: those of the settings mean torques."""


def packed(openness: float, at_s: float, position_mm: float = 0.0, force_n: float = 0.0) -> bytes:
    return struct.pack(">dddd", openness, position_mm, force_n, at_s)


OPEN = LinkStatus("open")
MASTER: dict[str, Any] = {"mode": "master"}
SLAVE: dict[str, Any] = {"mode": "slave", "host": "leader"}
FAKE: dict[str, Any] = {"mode": "slave", "fake_leader": True}


@dataclass(slots=True)
class Wire:
    """A link whose network is the test: what is to arrive, and what was sent."""

    options: LinkOptions
    arriving: list[Arrival] = field(default_factory=list)
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    replied: list[tuple[float, bytes, str]] = field(default_factory=list)
    told: list[tuple[float, bytes]] = field(default_factory=list)
    status: LinkStatus = OPEN
    takes: bool = True
    is_closed: bool = False

    def publish(self, payload: bytes, now_s: float) -> bool:
        if self.takes:
            self.sent.append((now_s, payload))
        return self.takes

    def reply(self, payload: bytes, to: str, now_s: float) -> bool:
        if self.takes:
            self.replied.append((now_s, payload, to))
        return self.takes

    def tell(self, payload: bytes, now_s: float) -> bool:
        if self.takes:
            self.told.append((now_s, payload))
        return self.takes

    def receive(self, now_s: float) -> Sequence[Arrival]:
        due = [arrival for arrival in self.arriving if arrival.at_s <= now_s]
        self.arriving = [arrival for arrival in self.arriving if arrival.at_s > now_s]
        return due

    def close(self) -> None:
        self.is_closed = True


class Wires:
    """Makes `Wire`s, and keeps them."""

    def __init__(self) -> None:
        self.made: list[Wire] = []

    def open(self, options: LinkOptions) -> Wire:
        self.made.append(Wire(options))
        return self.made[-1]

    def warning(self, options: LinkOptions) -> str | None:
        return f"{options.kind} is open to everybody"


class TeleopWorld(World):
    """A world whose links are the test's."""

    def __init__(self, mount: str = "normal", opening_mm: float = HALF_MM, **more: Any) -> None:
        super().__init__(mount, initial_opening_mm=opening_mm, **more)
        self.wires = Wires()
        self.service = build_service(
            self.controller, FixedFacts(), PERIOD_S, dumps=self.dumps, links=self.wires
        )

    @property
    def wire(self) -> Wire:
        return self.wires.made[-1]

    @property
    def openness(self) -> float:
        return self.gripper.opening_mm / TRAVEL_MM


@dataclass(slots=True)
class Follower:
    """A follower, and a leader that is a function of time."""

    world: TeleopWorld
    client: Client
    events: list[dict[str, Any]] = field(default_factory=list)
    sent: int = 0

    def status(self) -> dict[str, Any]:
        return self.client.result("teleop.status")

    def put(self, payload: bytes, source: str = "", delay_s: float = 0.0) -> None:
        """Let a payload arrive in the next tick, or later."""
        at_s = self.world.now_s + delay_s
        self.world.wire.arriving.append(Arrival(payload, at_s, source))

    def say(self, openness: float, delay_s: float = 0.0) -> None:
        self.sent += 1
        self.put(packed(openness, self.world.now_s), "", delay_s)

    def lead(
        self,
        course: Callable[[float], float],
        duration_s: float,
        rate_hz: float = 200.0,
        each: Callable[[], Any] = lambda: None,
    ) -> list[Any]:
        """Send `course(t)`, t from 0 to `duration_s`; return what `each` was after each tick."""
        began_s, seen = self.world.now_s, []
        every = round(1.0 / rate_hz / PERIOD_S)
        for tick in range(round(duration_s / PERIOD_S)):
            if tick % every == 0:
                self.say(course(self.world.now_s - began_s))
            self.world.tick()
            seen.append(each())
        return seen

    def stay(self, openness: float, duration_s: float) -> None:
        self.lead(lambda _t: openness, duration_s)

    def command(self) -> Any:
        return self.world.commands_since(self.world.now_s)[-1][1]

    @property
    def lead_rad(self) -> float:
        """By how much the command leads what the daemon measured."""
        return abs(float(self.command().position_rad) - self.world.measured.position_rad)

    def reported(self) -> list[str]:
        return [str(event["message"]) for event in self.client.events()]


def following(
    mount: str = "normal",
    opening_mm: float = HALF_MM,
    aligned: bool = True,
    nm_to_n: float | None = None,
    **params: Any,
) -> Follower:
    """Return a follower that has aligned to a leader as open as itself."""
    world = TeleopWorld(mount, opening_mm)
    if nm_to_n is not None:
        geometry = replace(NOMINAL[MOUNTS.index(mount)], nm_to_n=nm_to_n)
        world.controller.use_calibration(Calibration(geometry))
    client = world.enabled()
    client.result("events.subscribe", kinds=["teleop"])
    client.result("teleop.start", mode="slave", host="leader", **params)
    follower = Follower(world, client)
    if aligned:
        follower.stay(world.openness, 0.3)
        assert follower.status()["phase"] == "following"
    return follower


def sweep(from_: float, to: float, duration_s: float) -> Callable[[float], float]:
    """A hand's motion: from one openness to another, smoothly, and then still."""

    def course(t_s: float) -> float:
        share = min(max(t_s / duration_s, 0.0), 1.0)
        return from_ + (to - from_) * (0.5 - 0.5 * math.cos(math.pi * share))

    return course


@dataclass
class Pair:
    """A leader, a follower, and the network between them: it loses, delays, or is cut.

    `delay_s` is that of one way.
    """

    leader: TeleopWorld
    follower: TeleopWorld
    leading: Client
    following: Client
    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    is_cut: bool = False
    passes_ready: bool = True
    """False for an older end: it neither says nor hears whether it is ready."""
    dice: random.Random = field(default_factory=lambda: random.Random(5))
    carried: dict[int, int] = field(default_factory=dict)

    def tick(self) -> None:
        self.leader.tick()
        self.follower.tick()
        for name, one, other in (
            ("leader", self.leader, self.follower),
            ("follower", self.follower, self.leader),
        ):
            for wire in one.wires.made:
                self._carry(wire.sent, name, other)
                self._carry(wire.replied, name, other)
                if self.passes_ready:
                    self._carry(wire.told, name, other)

    def _carry(self, sent: Sequence[tuple[Any, ...]], name: str, to: TeleopWorld) -> None:
        for at_s, payload, *whom in sent[self.carried.get(id(sent), 0) :]:
            assert whom in ([], ["leader"])
            if not self.is_cut and self.dice.random() >= self.loss and to.wires.made:
                late_s = self.delay_s + self.jitter_s * self.dice.random()
                to.wire.arriving.append(Arrival(payload, at_s + late_s, name))
        self.carried[id(sent)] = len(sent)

    def run(self, duration_s: float) -> None:
        for _ in range(round(duration_s / PERIOD_S)):
            self.tick()

    def until(self, condition: Callable[[], object], within_s: float = 12.0) -> float:
        """Let time pass until a condition holds; return for how long."""
        for tick in range(round(within_s / PERIOD_S)):
            if condition():
                return tick * PERIOD_S
            self.tick()
        raise AssertionError(f"did not happen: {self.leads}, {self.follows}")

    @property
    def leads(self) -> dict[str, Any]:
        """The leader's status."""
        return self.leading.result("teleop.status")

    @property
    def follows(self) -> dict[str, Any]:
        """The follower's status."""
        return self.following.result("teleop.status")
