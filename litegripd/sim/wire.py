"""The way between the bus and the motor, with what may happen to frames on it in each direction.

Every frame to the motor goes through `carry`, every answer comes out of it, or later out of
`late`. It knows no bus and no clock. Not thread-safe, except for setting the faults; the owner
serialises calls.
"""

from __future__ import annotations

import heapq
import math

from litegripd.model.motor import CanFrame
from litegripd.sim.faults import FrameFaults
from litegripd.sim.gripper import SimulatedGripper

Arrival = tuple[float, CanFrame]
"""A frame, behind the time in seconds at which it arrives."""


class MotorWire:
    """A gripper behind its wire. Without faults it is the gripper's own `receive`."""

    def __init__(self, gripper: SimulatedGripper) -> None:
        self.gripper = gripper
        self.to_motor = FrameFaults("to the motor")
        self.from_motor = FrameFaults("from the motor")
        self._late: list[tuple[float, int, bool, CanFrame]] = []
        self._number = 0  # keeps the order of frames that arrive at the same time

    def seed(self, seed: int) -> None:
        """Restart the chances of both directions."""
        self.to_motor.seed(seed)
        self.from_motor.seed(seed)

    @property
    def next_s(self) -> float:
        """When the next late frame arrives; infinite when none is under way."""
        return self._late[0][0] if self._late else math.inf

    def carry(self, now_s: float, due_s: float, frame: CanFrame) -> list[Arrival]:
        """Send a frame to the motor; return the answers that are due at `due_s`, and no later."""
        if not self.to_motor.is_used:
            return self.deliver(now_s, due_s, frame)
        answers: list[Arrival] = []
        for at_s, arriving in self.to_motor.arrivals(due_s, frame):
            if at_s > due_s:
                self._keep(at_s, True, arriving)
            else:
                answers += self.deliver(now_s, due_s, arriving)
        return answers

    def deliver(self, now_s: float, due_s: float, frame: CanFrame) -> list[Arrival]:
        """Hand a frame to the motor whatever the faults on the way to it; return as `carry`."""
        answers = self.gripper.receive(now_s, frame)
        if not self.from_motor.is_used:
            return [(due_s, answer) for answer in answers]
        found: list[Arrival] = []
        for answer in answers:
            for at_s, arriving in self.from_motor.arrivals(due_s, answer):
                if at_s > due_s:
                    self._keep(at_s, False, arriving)
                else:
                    found.append((at_s, arriving))
        return found

    def late(self, now_s: float) -> list[Arrival]:
        """Let what is due by `now_s` arrive; return the answers among it, in their order."""
        answers: list[Arrival] = []
        while self._late and self._late[0][0] <= now_s:
            at_s, _, is_to_motor, frame = heapq.heappop(self._late)
            answers += self.deliver(at_s, at_s, frame) if is_to_motor else [(at_s, frame)]
        return answers

    def lose_late(self) -> None:
        """Lose what is still under way."""
        self._late.clear()

    def _keep(self, at_s: float, is_to_motor: bool, frame: CanFrame) -> None:
        self._number += 1
        heapq.heappush(self._late, (at_s, self._number, is_to_motor, frame))
