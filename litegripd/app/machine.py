"""The gripper as one pure machine: frames in, frames out, time as an argument.

Controller and motor do not know each other; this file connects them, for real time and for tests.

`Ending` is the end of a daemon: it waits, for a limited time, until the motor is disabled.
"""

import logging
from collections.abc import Sequence

from litegrip_client.values.repeats import AFTER_COUNTS
from litegripd.control.controller import Controller
from litegripd.model.errors import Refusal
from litegripd.model.gripper import GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import UP, BusCondition, CanFrame, MotorPhase
from litegripd.motor.exchange import SILENT_AFTER_POLLS
from litegripd.motor.motor import Motor
from litegripd.motor.phases import SILENT

_log = logging.getLogger(__name__)

_NOT_REACHED = (
    "the motor does not answer, and {}; if it is not that, check the motor's 24 V supply, the CAN"
    " wiring and its id"
)

OFF = (MotorPhase.DISABLED, MotorPhase.FAULT)
"""Phases of a motor that has confirmed that it is not energised."""


class Machine:
    """One motor and the controller that drives it."""

    def __init__(
        self, gripper_id: GripperId, master_id: int | None, config: MotionConfig, period_s: float
    ) -> None:
        self.motor = Motor(gripper_id.can_id, master_id, period_s, gripper_id.motor_type)
        self.controller = Controller(config, period_s, gripper_id)
        self.may_be_energised: bool | None = None
        """True if the motor was being enabled, or reported that it is, and has not confirmed since
        that it is off; None until either has happened."""
        self._sent: list[CanFrame] = []

    def tick(
        self, now_s: float, received: Sequence[CanFrame], bus: BusCondition = UP
    ) -> list[CanFrame]:
        """Take the frames received since the last tick; return the frames to send.

        If the bus cannot be used, that is the reason why the motor cannot be used. A defect that
        raises ends the running job, so that the next tick holds.
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
        if bus.is_usable and bus.error is not None:  # the adapter is the nearer suspect
            doubted = Refusal("motor_silent", _NOT_REACHED.format(bus.error))
            if view.problem is SILENT:
                view = view._replace(problem=doubted)
            if view.failure is SILENT:
                view = view._replace(failure=doubted)
        if is_silent and bus.is_usable and view.problem is not None:
            bus = BusCondition("motor_silent", view.problem.message)
        refusal = bus.refusal(self.controller.gripper_id.bus_channel)
        if refusal is not None:
            view = view._replace(problem=refusal)
        self.controller.note_bus(bus)
        must_disable = self.controller.must_disable
        try:
            wanted = self.controller.step(now_s, view)
            self._sent = self.motor.step(now_s, wanted)
        except Exception as error:
            self.controller.break_off(error)
            self.controller.must_disable |= must_disable  # the step may have failed before
            raise
        return self._sent

    def take_sent(self) -> list[CanFrame]:
        """Return, once, the frames that the latest tick sent; none if it failed before."""
        sent, self._sent = self._sent, []
        return sent

    @property
    def needs_commands(self) -> bool:
        """True while a motor that can be reached may be energised: without commands it lets go."""
        return self.may_be_energised is True and self.controller.bus.is_usable

    @property
    def is_missed(self) -> bool:
        """True if somebody needs the motor, or it may be energised by somebody else."""
        return self.controller.is_missed or self.may_be_energised is True

    @property
    def is_disabled(self) -> bool:
        """True if the motor has confirmed that it is not energised."""
        return self.motor.view().phase in OFF

    @property
    def is_out_of_reach(self) -> bool:
        """True if the motor does not answer, or is not identified yet."""
        return self.motor.view().phase in (MotorPhase.SILENT, MotorPhase.UNKNOWN)


END_WITHIN_S = 1.5
"""How long the end waits until the motor confirms that it is disabled."""

FIND_WITHIN_S = 0.3
"""How long the end waits for a motor that does not answer: it may be found, and be enabled."""


_PARTING = {
    may_be_energised: Refusal("shutting_down", text, {"motor_off": may_be_energised is False})
    for may_be_energised, text in (
        (False, "the daemon has ended; the motor is off, and what was held falls"),
        (True, "the daemon has ended; the motor did not confirm that it is off: cut its power"),
        (None, "the daemon has ended; it is not known whether the motor is off: cut its power"),
    )
}


class Ending:
    """The end of a daemon: disables the motor, and waits for that for a limited time."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._since_s: float | None = None

    @property
    def has_begun(self) -> bool:
        """True if the end has begun."""
        return self._since_s is not None

    def begin(self, now_s: float) -> None:
        """Begin the end: the next tick disables the motor."""
        if self._since_s is None:
            _log.info("ending: the motor is being disabled", extra=AFTER_COUNTS)
            self._since_s = now_s
            self._machine.controller.shut_down()

    def is_over(self, now_s: float) -> bool:
        """Return True if the end has begun and there is nothing more to wait for."""
        if self._since_s is None:
            return False
        waited_s = now_s - self._since_s
        if self._machine.is_out_of_reach and waited_s >= FIND_WITHIN_S:
            return True
        return self._machine.is_disabled or waited_s >= END_WITHIN_S

    def parting(self) -> Refusal | None:
        """Return what to tell clients at the end of their connections; None before the end."""
        if self._since_s is None:
            return None
        return _PARTING[self._machine.may_be_energised]

    def report(self) -> bool:
        """Log the outcome; return False if the motor may still be energised.

        A motor that has never answered mostly has no power: that is logged, but is no failure.
        """
        may_be_energised = self._machine.may_be_energised
        phase = self._machine.motor.view().phase.value
        capture = self._machine.controller.capture
        if capture is not None and capture.samples and not capture.is_taken:
            _log.warning("a recording of %d samples is lost: nobody has kept it", capture.samples)
        if may_be_energised is None:
            _log.warning("ended; it is not known whether the motor is off (%s)", phase)
        elif may_be_energised:
            _log.error("ended; the motor did not confirm that it is off (%s): cut its power", phase)
        else:
            _log.info("ended; the motor is off (%s)", phase)
        return not may_be_energised
