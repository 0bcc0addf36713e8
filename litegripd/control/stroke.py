"""One stroke to a stop with a run-up: it confirms, or corrects, what a probe has found.

Standing and slow jaws may stick where moving ones pass (the closing side does, in front of its
stop), and a probe that pushes gently is slow. So the jaws come with the speed of an `open` or
`close`, bounded by a torque whatever they meet. Where they slow down, they are left to a probe,
which presses no harder than the first one did: a stop that yields is met as deep as before.
"""

from collections import deque
from typing import Literal, TypeAlias

from litegripd.control.gains import Gains
from litegripd.control.probe import Probe
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

StrokeVerdict: TypeAlias = Literal["at_stop", "stuck", "not_found"]

RUN_SHARE = 0.85
"""Of `calib_tau_limit`: jaws that bounce, and the lag of a measurement, need the rest."""
DAMPING_SHARE = 0.5
"""At most so much of the torque comes from the velocity, the rest from the lead."""

WINDOW_S = 0.02
SLOWED_SHARE = 0.5
LEAST_RAD_S = 0.1
"""Slower jaws are not past what makes slow jaws stick; 7 mm/s of the standard gripper."""
START_WITHIN_S = 0.5


class Stroke:
    """Drives the jaws towards one side (`sign` of the motor's radians) until they stand still.

    `friction_nm` is the mean torque while they moved, None before.
    """

    def __init__(self, sign: int, config: MotionConfig, speed_rad_s: float) -> None:
        torque_nm = RUN_SHARE * config.calib_tau_limit
        self._sign = sign
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._speed_rad_s = speed_rad_s
        self._torque_limit_nm = config.calib_tau_limit
        self._fed_rad_s = min(speed_rad_s, DAMPING_SHARE * torque_nm / config.calib_kd)
        left_nm = torque_nm - config.calib_kd * self._fed_rad_s
        self._lead_rad = min(config.calib_step_rad, left_nm / config.calib_kp)
        self._probe = Probe(sign, config)
        self._probing = False
        self._led: tuple[float, float] | None = None
        self._began_s: float | None = None
        self._window: deque[tuple[float, float]] = deque()
        self._fastest_rad_s = 0.0
        self._torque_sum_nm = 0.0
        self._torques = 0
        self.ticks = 0

    @property
    def friction_nm(self) -> float | None:
        """The mean torque of the way."""
        return self._torque_sum_nm / self._torques if self._torques else None

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, StrokeVerdict | None]:
        """Drive on, or press, and judge whether the jaws are at the end."""
        self.ticks += 1
        if self._probing:
            command, verdict = self._probe.step(now_s, feedback)
            return command, "at_stop" if verdict == "found" else verdict
        if self._began_s is None:
            self._began_s = now_s
        pushed_nm = self._sign * feedback.torque_nm
        has_slowed = self._has_slowed(now_s, feedback)
        if has_slowed or pushed_nm >= self._torque_limit_nm:
            self._probing = True
            return self._gains.at(feedback.position_rad), None
        if self._fastest_rad_s < LEAST_RAD_S and now_s - self._began_s > START_WITHIN_S:
            return self._gains.at(feedback.position_rad), "stuck"
        if self._fastest_rad_s >= LEAST_RAD_S:
            self._torque_sum_nm += pushed_nm
            self._torques += 1
        return self._led_on(now_s, feedback.position_rad), None

    def _led_on(self, now_s: float, position_rad: float) -> MitCommand:
        """Advance the target by the speed, but never further than the lead allows."""
        since_s, target_rad = self._led or (now_s, position_rad)
        ahead_rad = (target_rad - position_rad) * self._sign
        ahead_rad += self._speed_rad_s * (now_s - since_s)
        ahead_rad = min(max(ahead_rad, -self._lead_rad), self._lead_rad)
        target_rad = position_rad + self._sign * ahead_rad
        self._led = (now_s, target_rad)
        return self._gains.at(target_rad, self._sign * self._fed_rad_s)

    def _has_slowed(self, now_s: float, feedback: Feedback) -> bool:
        """Whether jaws that were moving have lost half of their speed, over some 20 ms."""
        window = self._window
        window.append((now_s, feedback.position_rad))
        while len(window) > 2 and now_s - window[1][0] >= WINDOW_S * 0.999:
            window.popleft()
        since_s, from_rad = window[0]
        if now_s - since_s < WINDOW_S * 0.999:
            return False
        speed_rad_s = self._sign * (feedback.position_rad - from_rad) / (now_s - since_s)
        self._fastest_rad_s = max(self._fastest_rad_s, speed_rad_s)
        is_slow = speed_rad_s < SLOWED_SHARE * self._fastest_rad_s
        return is_slow and self._fastest_rad_s >= LEAST_RAD_S
