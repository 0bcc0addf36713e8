"""The gripper as one pure machine: frames in, frames out, time as an argument.

Engine and motor know nothing of each other; this is where they meet, in real time and in tests.
"""

from collections.abc import Sequence
from dataclasses import replace

from litegripd.control.engine import Engine
from litegripd.model.bus import UP, BusCondition
from litegripd.model.frame import CanFrame
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MotorPhase
from litegripd.model.unit import Unit
from litegripd.motor.motor import Motor
from litegripd.motor.silence import SILENT_AFTER_POLLS

OFF = (MotorPhase.DISABLED, MotorPhase.FAULT)
"""Phases of a motor that has confirmed that it is not energised."""


class Machine:
    """One motor and the engine that drives it."""

    def __init__(
        self, unit: Unit, master_id: int | None, config: MotionConfig, period_s: float
    ) -> None:
        self.motor = Motor(unit.can_id, master_id, period_s, unit.motor_type)
        self.engine = Engine(config, period_s, unit)
        self.may_be_energised: bool | None = None
        """Whether the motor was being enabled, or said that it is, and has not confirmed since that
        it is off; None until it has said either."""
        self._sent: list[CanFrame] = []

    def tick(
        self, now_s: float, received: Sequence[CanFrame], bus: BusCondition = UP
    ) -> list[CanFrame]:
        """Take what the bus brought since the last tick; return what it is to be given.

        A bus that cannot be used explains why the motor cannot be. What raises by a defect ends the
        running job, so that the next tick holds.
        """
        self.motor.receive(now_s, received)
        self.motor.note_bus(is_usable=bus.is_usable)
        view = self.motor.view()
        if self.motor.says_enabled or view.phase in (MotorPhase.ENABLING, MotorPhase.ENABLED):
            self.may_be_energised = True
        elif view.phase in OFF:
            self.may_be_energised = False
        is_asked = self.motor.unanswered > SILENT_AFTER_POLLS  # since the bus is open
        is_silent = view.phase is MotorPhase.SILENT and is_asked
        if is_silent and bus.is_usable and view.problem is not None:
            bus = BusCondition("motor_silent", view.problem.message)
        refusal = bus.refusal(self.engine.unit.bus_channel)
        if refusal is not None:
            view = replace(view, problem=refusal)
        self.engine.note_bus(bus)
        must_disable = self.engine.must_disable
        try:
            order = self.engine.step(now_s, view)
            self._sent = self.motor.step(now_s, order)
        except Exception as error:
            self.engine.break_off(error)
            self.engine.must_disable |= must_disable  # it may not have got that far
            raise
        return self._sent

    def take_sent(self) -> list[CanFrame]:
        """Return once what the latest tick gave to the bus; nothing, where it failed before."""
        sent, self._sent = self._sent, []
        return sent

    @property
    def needs_commands(self) -> bool:
        """True while a motor may be energised that can be reached: it lets go without commands."""
        return self.may_be_energised is True and self.engine.bus.is_usable

    @property
    def is_disabled(self) -> bool:
        """Whether the motor has confirmed that it is not energised."""
        return self.motor.view().phase in OFF

    @property
    def is_out_of_reach(self) -> bool:
        """Whether the motor does not answer, or has not told yet what it is."""
        return self.motor.view().phase in (MotorPhase.SILENT, MotorPhase.UNKNOWN)
