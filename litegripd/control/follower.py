"""Leading the jaws along a target that moves, with no more than a torque, whatever they meet.

The command moves towards the target at no more than a speed: jaws that were held up do not jump
when they come free.
"""

from litegripd.control.budget import budgeted
from litegripd.control.gains import Gains
from litegripd.control.lead import led
from litegripd.control.rest import Hold
from litegripd.model.motor import Feedback, MitCommand

_SLOWEST_RAD_S = 1e-3


class Follower:
    """Makes the commands of one motion; `rest` goes on pressing as the latest one did."""

    def __init__(self, gains: Gains, torque_nm: float, period_s: float) -> None:
        self.rest: Hold | None = None
        self._gains = gains
        self._torque_nm = torque_nm
        self._period_s = period_s
        self._was_s: float | None = None
        self._was_rad = 0.0

    @property
    def reference_rad(self) -> float | None:
        """Where the latest command was, None before the first one."""
        return None if self._was_s is None else self._was_rad

    def reset(self) -> None:
        """Begin anew from where the jaws are, whenever the next step is."""
        self.rest, self._was_s = None, None

    def step(
        self, now_s: float, feedback: Feedback, target_rad: float, speed_rad_s: float
    ) -> MitCommand:
        """Return the command of this tick, at most `speed_rad_s` faster towards the target.

        The stiffness is that of the speed which the command has now, so that a path's fastest part
        does not make the slow ones soft.
        """
        if self._was_s is None:
            self._was_s, self._was_rad = now_s, feedback.position_rad
        elapsed_s = max(now_s - self._was_s, 0.0)
        most_rad = speed_rad_s * elapsed_s
        step_rad = min(max(target_rad - self._was_rad, -most_rad), most_rad)
        velocity_rad_s = step_rad / elapsed_s if elapsed_s > 0.0 else 0.0
        speed = max(abs(velocity_rad_s), _SLOWEST_RAD_S)
        gains, lead_rad = budgeted(self._torque_nm, speed, self._gains, self._period_s)
        reference_rad = led(self._was_rad + step_rad, feedback.position_rad, lead_rad)
        self._was_s, self._was_rad = now_s, reference_rad
        self.rest = Hold(reference_rad, gains)
        return gains.at(reference_rad, velocity_rad_s)
