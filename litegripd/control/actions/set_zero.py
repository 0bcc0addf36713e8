"""Setting the motor's own zero: disabled first, then set, watched until the position confirms it.

The jaws do not move. What the positions of a calibration mean is changed by it: the result says by
how much.
"""

from litegripd.control.actions.base import PlainAction, Step
from litegripd.model.errors import Refusal
from litegripd.model.motor import DisableMotor, MotorPhase, MotorView
from litegripd.model.motor import SetZero as SetZeroRequest
from litegripd.model.results import SetZeroResult

_DISABLE_WITHIN_S = 1.0
_GIVES_UP_S = 2.0
_NOT_CONFIRMED = Refusal(
    "not_confirmed", "the motor does not confirm that it is disabled, so its zero was not set"
)
_NO_END = Refusal(
    "not_confirmed",
    "the motor's zero was not confirmed in time: find out where the jaws are before they are moved",
)


class SetZero(PlainAction):
    """Makes the present position the zero of the motor's positions; the motor ends disabled.

    What the motor does goes on when this is ended early: `MotorView.zero` tells how it ended.
    """

    needs_power = False

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._asked_to_disable = False
        self._asked_s: float | None = None
        self._was_begun = False

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Disable the motor unless it is disabled, ask once for the zero, then watch."""
        if self._began_s is None:
            self._began_s = now_s
        if self._asked_s is not None:
            return self._watch(now_s - self._asked_s, motor)
        problem = motor.fault or motor.problem
        if problem is not None:
            return Step(outcome=problem)
        if motor.phase is MotorPhase.DISABLED:
            self._asked_s = now_s
            return Step(request=SetZeroRequest())
        if not self._asked_to_disable:
            self._asked_to_disable = True
            return Step(request=DisableMotor())
        waits = now_s - self._began_s < _DISABLE_WITHIN_S
        return Step(outcome=None if waits else motor.failure or _NOT_CONFIRMED)

    def _watch(self, asked_for_s: float, motor: MotorView) -> Step:
        """Take the end of what was begun here, never that of an earlier setting."""
        zero = motor.zero
        self._was_begun = self._was_begun or zero.state == "pending"
        if zero.state == "done" and self._was_begun:
            return Step(outcome=SetZeroResult(True, zero.shift_rad, zero.position_rad))
        if zero.state == "failed":
            why = None if zero.is_uncertain else motor.problem
            return Step(outcome=why or zero.failure or _NO_END)
        return Step(outcome=_NO_END if asked_for_s >= _GIVES_UP_S else None)
