"""Scenes of leader and follower in virtual time: two grippers, or one and frames by a script.

The frames of a script are packed by `struct` alone, as the facts describe them.
"""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from litegripd.app.build import build_service
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.motion_config import MOVING_KP_NM_RAD, MotionConfig
from litegripd.model.teleop import Arrival, LinkOptions, LinkStatus
from litegripd.sim.plant import MOUNTS, SimulatorParameters, limits_of_mount
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
        closed_rad, open_rad = limits_of_mount(mount)
        parameters = SimulatorParameters(
            closed_rad=closed_rad, open_rad=open_rad, initial_opening_mm=opening_mm
        )
        super().__init__(mount, parameters=parameters, **more)
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
        each: Callable[[], None] = lambda: None,
    ) -> None:
        """Send `course(t)`, t from 0 to `duration_s`, and let time pass."""
        began_s = self.world.now_s
        every = round(1.0 / rate_hz / PERIOD_S)
        for tick in range(round(duration_s / PERIOD_S)):
            if tick % every == 0:
                self.say(course(self.world.now_s - began_s))
            self.world.tick()
            each()

    def stay(self, openness: float, duration_s: float) -> None:
        self.lead(lambda _t: openness, duration_s)

    def command(self) -> Any:
        return self.world.commands_since(self.world.now_s)[-1][1]

    @property
    def lead_rad(self) -> float:
        """By how much the command leads what the daemon measured."""
        feedback = self.world.controller.motor.feedback
        assert feedback is not None
        return abs(float(self.command().position_rad) - feedback.position_rad)

    def reported(self) -> list[str]:
        self.client.read()
        reported = [n["params"] for n in self.client.notifications if n["method"] == "event"]
        return [str(event["message"]) for event in reported]


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
