"""The end of a daemon: the motor is disabled, and that is waited for, but not for ever."""

import logging

from litegripd.app.machine import Machine

_log = logging.getLogger(__name__)

END_WITHIN_S = 1.5
"""So long the end waits for the motor to confirm that it is disabled."""

FIND_WITHIN_S = 0.3
"""So long the end waits for a motor that does not answer: it might be found, and be enabled."""


class Ending:
    """Whether and since when the end has begun."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._since_s: float | None = None

    @property
    def has_begun(self) -> bool:
        """Whether the daemon has been told to end."""
        return self._since_s is not None

    def begin(self, now_s: float) -> None:
        """Begin the end: the motor is disabled in the next tick."""
        if self._since_s is None:
            _log.info("ending: the motor is being disabled")
            self._since_s = now_s
            self._machine.engine.shut_down()

    def is_over(self, now_s: float) -> bool:
        """Whether the end has begun and nothing is to be waited for any more."""
        if self._since_s is None:
            return False
        waited_s = now_s - self._since_s
        if self._machine.is_out_of_reach and waited_s >= FIND_WITHIN_S:
            return True
        return self._machine.is_disabled or waited_s >= END_WITHIN_S

    def tell(self) -> bool:
        """Log how it has ended; return False if the motor may be energised still.

        One that has never told anything mostly has no power: that is no failure, but is told.
        """
        may_be_energised = self._machine.may_be_energised
        phase = self._machine.motor.view().phase.value
        if may_be_energised is None:
            _log.warning("ended; it is not known whether the motor is off (%s)", phase)
        elif may_be_energised:
            _log.error("ended; the motor did not confirm that it is off (%s): cut its power", phase)
        else:
            _log.info("ended; the motor is off (%s)", phase)
        return not may_be_energised
