"""A `BusWorld` in which more can fail: single frames by their kind, ticks, and python-can itself.

It also judges what comes to an enabled motor: how old each command is, by the time at which the
daemon gave it to its bus.
"""

from collections import Counter
from typing import Any

import can

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.motor import ENABLED
from litegripd.sim.plant import SimulatorParameters
from tests.bus_world import BusWorld, RecordingGripper
from tests.world import CAN_ID, is_command


class FaultGripper(RecordingGripper):
    """Loses frames by their data, as `deaf_to` counts them; notes commands that it obeys."""

    def __init__(self, parameters: SimulatorParameters) -> None:
        super().__init__(parameters)
        self.deaf_to: Counter[bytes] = Counter()
        self.foreign: set[bytes] = set()
        self.obeyed: list[tuple[float, CanFrame]] = []

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        if self.deaf_to[frame.data] > 0:
            self.deaf_to[frame.data] -= 1
            return []
        is_own = frame.can_id == CAN_ID and is_command(frame) and frame.data not in self.foreign
        if is_own and self.motor.status == ENABLED:
            self.obeyed.append((now_s, frame))
        return super().receive(now_s, frame)


class FaultWorld(BusWorld):
    """`oldest_s` is the age of the oldest command of the daemon that an enabled motor has got."""

    gripper: FaultGripper

    def __init__(self, mount: str = "normal", **options: Any) -> None:
        super().__init__(mount, **options)
        self.oldest_s = 0.0

    def __enter__(self) -> "FaultWorld":
        return self

    def make_gripper(self, parameters: SimulatorParameters) -> SimulatedGripper:
        return FaultGripper(parameters)

    def tick(self) -> None:
        super().tick()
        if self.gripper.obeyed:
            self._judge_obeyed()

    def inject(self, frame: CanFrame) -> None:
        self.gripper.foreign.add(frame.data)  # the daemon may have sent the same once
        super().inject(frame)

    def skip(self, seconds: float) -> None:
        """Let the daemon be late: time passes without a tick."""
        self.now_s += seconds

    def fail_receiving(self, error: Exception) -> None:
        """Let python-can raise on every reading, until `work_again` or until it is opened anew."""

        def recv(timeout: float | None = None) -> can.Message | None:
            raise error

        if self.bus._bus is not None:
            self.bus._bus.recv = recv  # type: ignore[method-assign]

    def fail_sending(self, error: Exception) -> None:
        """Let python-can raise on every sending, until `work_again` or until it is opened anew."""

        def send(msg: can.Message, timeout: float | None = None) -> None:
            raise error

        if self.bus._bus is not None:
            self.bus._bus.send = send  # type: ignore[method-assign]

    def work_again(self) -> None:
        """Let python-can do what it did."""
        for name in ("recv", "send"):
            vars(self.bus._bus or self).pop(name, None)

    def _judge_obeyed(self) -> None:
        """Find when the daemon sent each; one that it has sent again since counts from then."""
        for at_s, frame in self.gripper.obeyed:
            sent = (s.at_s for s in reversed(self.sent) if s.frame == frame and s.at_s <= at_s)
            self.oldest_s = max(self.oldest_s, at_s - next(sent, at_s))
        self.gripper.obeyed.clear()
