"""The whole daemon but its sockets, as in `tests.world`, on a gripper that is not the simulator's.

Frames take their time on the way, each its own, and keep their order.
"""

import heapq
import random
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from litegripd.model.gripper import DM4310, MotorType
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import CanFrame
from tests.plants.motor import PlantMotor
from tests.plants.parameters import MM_RAD, PlantParameters
from tests.world import FRAME_TIME_S, Sent, World

LOOK_S = 1e-3


class Look(NamedTuple):
    """What is true at one moment; speeds count towards closed."""

    at_s: float
    clamp_n: float
    opening_mm: float
    jaw_mm_s: float
    rotor_mm_s: float
    torque_nm: float
    """The motor's true torque, squeezing positive."""


class PlantWorld(World):
    """One daemon and one `PlantMotor`.

    `looks` keeps what is true in every millisecond. There is no `gripper`; `plant` is in its place.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        mount: str = "normal",
        rate_hz: int = 200,
        *,
        opening_mm: float = 60.0,
        config: MotionConfig | None = None,
        motor_type: MotorType = DM4310,
    ) -> None:
        super().__init__(mount, config=config, period_s=1.0 / rate_hz, motor_type=motor_type)
        del self.gripper  # that of the simulator: nothing moves it
        self.parameters = parameters
        self.plant = PlantMotor(parameters, mount, opening_mm)
        self.plant.advance(self.now_s)
        self.mechanics = self.plant.mechanics
        self.looks: list[Look] = []
        self._next_look_s = self.now_s + LOOK_S
        self._chance = random.Random(f"wire {parameters.seed}")
        self._agenda: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0
        self._last_s = [0.0, 0.0]  # of the latest arrival at the motor, and at the daemon
        self._answers: deque[tuple[float, CanFrame]] = deque()

    def at(self, at_s: float, act: Callable[[], None]) -> None:
        """Let something happen at a time that is no tick's."""
        self._number += 1
        heapq.heappush(self._agenda, (at_s, self._number, act))

    def advance(self) -> None:
        """Let what is due happen, each at its time."""
        while self._agenda and self._agenda[0][0] <= self.now_s:
            at_s, _, act = heapq.heappop(self._agenda)
            self._look_until(at_s)
            act()
        self._look_until(self.now_s)

    def exchange(self) -> None:
        received, self._in_flight = self._in_flight, []
        while self._answers and self._answers[0][0] <= self.now_s:
            received.append(self._answers.popleft()[1])
        for frame in self.machine.tick(self.now_s, received, self.condition):
            self.sent.append(Sent(self.now_s, frame))
            if not self.lose_to_motor(frame):
                self._send(self._arrival_s(0, self.now_s), frame)

    def _send(self, at_s: float, frame: CanFrame) -> None:
        self.at(at_s, lambda: self._deliver(at_s, frame))

    def _deliver(self, at_s: float, frame: CanFrame) -> None:
        for answer in self.plant.receive(at_s, frame):
            if not self.lose_from_motor(answer):
                self._answers.append((self._arrival_s(1, at_s), answer))

    def _arrival_s(self, way: int, now_s: float) -> float:
        """Return when a frame that is sent now arrives: after the one before, in any case."""
        p = self.parameters
        wait_s = 0.5 * p.delay_s + self._chance.uniform(0.0, p.jitter_s)
        at_s = max(now_s + wait_s, self._last_s[way]) + FRAME_TIME_S
        self._last_s[way] = at_s
        return at_s

    def _look_until(self, at_s: float) -> None:
        mechanics, plant = self.mechanics, self.plant
        while self._next_look_s <= at_s:
            plant.advance(self._next_look_s)
            self.looks.append(
                Look(
                    self._next_look_s,
                    10.0 * mechanics.clamp_nm,
                    mechanics.opening_mm,
                    mechanics.finger_rad_s * MM_RAD,
                    mechanics.rotor_rad_s * MM_RAD,
                    mechanics.torque_nm * self.parameters.torque_factor,
                )
            )
            self._next_look_s += LOOK_S
        plant.advance(at_s)

    def looks_since(self, since_s: float) -> list[Look]:
        """Return what has been true since a time."""
        count = len(self.looks)
        while count and self.looks[count - 1].at_s > since_s:
            count -= 1
        return self.looks[count:]

    def push_open(self, torque_nm: float, duration_s: float) -> None:
        """Let a hand push towards open from now on, for so long."""
        self.mechanics.hand_nm = -torque_nm
        self.at(self.now_s + duration_s, lambda: setattr(self.mechanics, "hand_nm", 0.0))

    def hold_open(self, by_mm: float, duration_s: float) -> None:
        """Let a hand open the jaws so far within a third of the time, hold them, and let go."""
        self.mechanics.hold_open(by_mm, duration_s / 3.0)
        self.at(self.now_s + duration_s, self.mechanics.let_go)
