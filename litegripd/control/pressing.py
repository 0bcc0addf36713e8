"""Pressing on a stop that was found: an end stays where it is, jaws that only stick come loose.

Standing jaws may stick in front of their stop by more than a probe pushes with, after a stroke
with a run-up, too. So they are pressed harder, but below the ceiling of a calibration, and slowly.
Ends are soft: what tells them from jaws that came loose is where the jaws are met again by the
same probe as before, once the press has been taken back. It is taken back by what friction keeps.
"""

from typing import Literal, TypeAlias

from litegripd.control.gains import Gains
from litegripd.control.probe import Probe
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

PressVerdict: TypeAlias = Literal["held", "gave_way", "not_found"]

HARD_SHARE = 0.95
"""Of `calib_tau_limit`: the jaws stand, so only noise needs the rest."""
LEFT_SHARE = 0.3
"""Of the probe's push, at most, remains while the press is taken back: the jaws stay in touch."""
RATE_NM_S = 4.0
REST_S = 0.1
FAR_TOLERANCES = 1.5
"""Times `stop_tol`: jaws that give way by so much need not be pressed harder."""


class Pressing:
    """Presses towards one side (`sign` of the motor's radians) from `stop_rad`, and probes again.

    `friction_nm` is the mean torque that moved the jaws.
    """

    def __init__(
        self, sign: int, stop_rad: float, friction_nm: float, config: MotionConfig
    ) -> None:
        self._sign = sign
        self._stop_rad = stop_rad
        self._tolerance_rad = config.stop_tol
        self._gains = Gains(config.calib_kp, config.calib_kd)
        limit_nm = HARD_SHARE * config.calib_tau_limit
        self._push_nm = min(config.calib_kp * config.calib_step_rad, limit_nm)
        self._most_nm = limit_nm
        self._least_nm = min(LEFT_SHARE * self._push_nm, self._push_nm - 2.0 * friction_nm)
        self._probe = Probe(sign, config)
        self._up_nm = self._push_nm
        self._up_since_s: float | None = None
        self._down_since_s: float | None = None

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, PressVerdict | None]:
        """Press, take it back, or probe; judge by where the jaws are met again."""
        if self._down_since_s is None:
            return self._press(now_s, feedback), None
        down_s = now_s - self._down_since_s
        fallen_nm = self._up_nm - RATE_NM_S * down_s
        if fallen_nm > self._least_nm - RATE_NM_S * REST_S:
            return self._pushed(feedback, max(fallen_nm, self._least_nm)), None
        command, verdict = self._probe.step(now_s, feedback)
        if verdict is None or verdict == "not_found":
            return command, verdict
        apart_rad = abs(feedback.position_rad - self._stop_rad)
        return command, "held" if apart_rad <= self._tolerance_rad else "gave_way"

    def _press(self, now_s: float, feedback: Feedback) -> MitCommand:
        if self._up_since_s is None:
            self._up_since_s = now_s
        wanted_nm = self._push_nm + RATE_NM_S * (now_s - self._up_since_s)
        self._up_nm = min(wanted_nm, self._most_nm)
        gave_rad = (feedback.position_rad - self._stop_rad) * self._sign
        if gave_rad >= FAR_TOLERANCES * self._tolerance_rad:
            self._up_nm = self._push_nm  # they may be thrown back by the end: damping adds to it
            self._down_since_s = now_s
        elif wanted_nm >= self._most_nm + RATE_NM_S * REST_S:
            self._down_since_s = now_s
        return self._pushed(feedback, self._up_nm)

    def _pushed(self, feedback: Feedback, torque_nm: float) -> MitCommand:
        """Return the command that makes a torque, and brakes whatever moves."""
        held = self._gains.at(feedback.position_rad)
        return MitCommand(
            held.position_rad, 0.0, held.kp_nm_rad, held.kd_nm_s_rad, self._sign * torque_nm
        )
