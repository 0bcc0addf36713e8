"""The gripper as one pure machine: frames in, frames out, time as an argument.

Engine and motor know nothing of each other; this is where they meet, in real time and in tests.
"""

from collections.abc import Sequence

from litegripd.control.engine import Engine
from litegripd.model.frame import CanFrame
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MotorPhase
from litegripd.motor.motor import Motor


class Machine:
    """One motor and the engine that drives it."""

    def __init__(
        self, can_id: int, master_id: int | None, config: MotionConfig, period_s: float
    ) -> None:
        self.motor = Motor(can_id, master_id)
        self.engine = Engine(config, period_s)

    def tick(self, now_s: float, received: Sequence[CanFrame]) -> list[CanFrame]:
        """Take what the bus brought since the last tick; return what it is to be given."""
        self.motor.receive(now_s, received)
        order = self.engine.step(now_s, self.motor.view())
        return self.motor.step(now_s, order)

    @property
    def is_unpowered(self) -> bool:
        """Whether the motor has confirmed that it is not energised, or does not answer at all."""
        phase = self.motor.view().phase
        return phase in (
            MotorPhase.DISABLED,
            MotorPhase.FAULT,
            MotorPhase.SILENT,
            MotorPhase.UNKNOWN,
        )
