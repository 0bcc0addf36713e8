"""How a follower's jaws are led to where its leader is: with a lead and a force that are bounded.

The command's lead over the measured position is capped as in every motion, whatever the frames say.
Damping relative to a velocity is a torque as well: jaws that are held up would be pushed by kd
times the leader's whole speed. So the leader's velocity is fed forward as far as the bounds allow.
"""

from collections import deque

from litegripd.control.budget import budgeted
from litegripd.control.gains import Gains
from litegripd.control.lead import lead_cap_rad, led
from litegripd.control.rest import Hold
from litegripd.model.geometry import FORCE_PER_TORQUE_N_NM, Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

MOST_NM = 5.5
"""By no more the jaws are pushed, however stiff the follow gains are: what the lead cap of 4 mm is
with the calibration's 100 N·m/rad."""

_SAMPLES = 3
"""A measured velocity is a tick or two old. Fed back at once it would make the jaws shake from tick
to tick; the slowest of so many does not."""

_SLOWEST_RAD_S = 1e-3


class Leading:
    """Makes the commands of one follower.

    With `force_limit_n` stiffness and damping are budgeted (`control/budget.py`): jaws that are
    stopped at once are pushed by no more than that, at any speed of the leader.
    """

    def __init__(
        self,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        force_limit_n: float | None,
        period_s: float,
    ) -> None:
        self.is_limited = False
        self.velocity_rad_s = 0.0
        self.hold: Hold | None = None
        """What goes on pressing as the latest command did, None before the first one."""
        self._geometry = geometry
        self._config = config
        self._gains = gains
        self._period_s = period_s
        limit_nm = None if force_limit_n is None else force_limit_n / FORCE_PER_TORQUE_N_NM
        self._limit_nm = None if limit_nm is None else min(limit_nm, MOST_NM)
        self._measured: deque[float] = deque(maxlen=_SAMPLES)

    @property
    def commanded_rad(self) -> float | None:
        """Where the latest command was, None before the first one."""
        return None if self.hold is None else self.hold.position_rad

    def let_go(self, here_rad: float) -> None:
        """Begin anew from where slack jaws are."""
        self.hold = Hold(here_rad, self._gains)
        self.velocity_rad_s = 0.0
        self.is_limited = False

    def within_reach(self, wanted_rad: float, here_rad: float) -> float:
        """Return how far towards `wanted_rad` jaws that are at `here_rad` can be led at rest."""
        _, lead_rad = self._bounds(wanted_rad, 0.0, here_rad)
        return led(wanted_rad, here_rad, lead_rad)

    def command(self, wanted_rad: float, velocity_rad_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick.

        From one tick to the next it steps by no more than the lead's cap either, unless the jaws
        themselves are elsewhere: frames that come late and at once do not turn it round.
        """
        here_rad, before_rad = feedback.position_rad, self.commanded_rad
        self._measured.append(feedback.velocity_rad_s)
        gains, lead_rad = self._bounds(wanted_rad, velocity_rad_s, here_rad)
        self.is_limited = led(wanted_rad, here_rad, lead_rad) != wanted_rad
        step_to_rad = wanted_rad if before_rad is None else led(wanted_rad, before_rad, lead_rad)
        commanded_rad = led(step_to_rad, here_rad, lead_rad)
        if self._limit_nm is None:
            ahead_rad = commanded_rad - here_rad
            velocity_rad_s = self._fed(velocity_rad_s, gains, lead_rad, ahead_rad)
        self.velocity_rad_s = velocity_rad_s
        self.hold = Hold(commanded_rad, gains)
        return gains.at(commanded_rad, velocity_rad_s)

    def _bounds(
        self, wanted_rad: float, velocity_rad_s: float, here_rad: float
    ) -> tuple[Gains, float]:
        """Return the gains, and how far the command may lead: less at the stop that lies ahead."""
        geometry, gains = self._geometry, self._gains
        closing = (wanted_rad - here_rad) * geometry.close_sign > 0.0
        limit_rad = geometry.closed_rad if closing else geometry.open_rad
        cap_rad = lead_cap_rad(abs(limit_rad - here_rad), geometry, self._config)
        if self._limit_nm is None:
            if gains.kp_nm_rad * cap_rad <= MOST_NM:  # kp may even be 0
                return gains, cap_rad
            # Far behind, the command follows the jaws as they were measured: stiffly it would shake
            # them. So the lead grows instead, with the same torque.
            wanted_lead_rad = max(abs(wanted_rad - here_rad), MOST_NM / gains.kp_nm_rad)
            lead_rad = min(wanted_lead_rad, cap_rad)
            return Gains(MOST_NM / lead_rad, gains.kd_nm_s_rad), lead_rad
        speed_rad_s = max(abs(velocity_rad_s), _SLOWEST_RAD_S)
        gains, lead_rad = budgeted(self._limit_nm, speed_rad_s, gains, self._period_s)
        return gains, min(cap_rad, lead_rad)

    def _fed(self, velocity_rad_s: float, gains: Gains, lead_rad: float, ahead_rad: float) -> float:
        """Return how much of the leader's velocity is fed forward: what torque the lead leaves.

        It may always brake.
        """
        kd = gains.kd_nm_s_rad
        if kd == 0.0 or velocity_rad_s == 0.0:
            return velocity_rad_s
        sign = 1.0 if velocity_rad_s > 0.0 else -1.0
        left_nm = gains.kp_nm_rad * (lead_rad - sign * ahead_rad)
        slowest_rad_s = min(sign * measured_rad_s for measured_rad_s in self._measured)
        return sign * min(sign * velocity_rad_s, max(slowest_rad_s + left_nm / kd, 0.0))
