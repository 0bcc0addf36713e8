"""Feeling for a mechanical stop with little torque, where no travel is known yet.

The command is derived anew from the measured position in every tick: an accumulated target went
on leading further at a stop until the structure gave way (field use of the gripper). The torque
ceiling does not depend on standing still, which a structure that yields never does. Only torque
towards the probed side counts: the first feedback still has the torque of what was before, such as
the press onto the other stop.
"""

from typing import Literal, TypeAlias

from litegripd.control.gains import Gains
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

ProbeVerdict: TypeAlias = Literal["found", "not_found"]


class Probe:
    """Pushes towards one side (`sign` of the motor's radians) until the jaws stand still."""

    def __init__(self, sign: int, config: MotionConfig) -> None:
        self._sign = sign
        self._config = config
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._sampled: tuple[float, float] | None = None
        self._still = 0
        self.iterations = 0

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, ProbeVerdict | None]:
        """Push on, and judge whether the stop has been met."""
        config, position_rad = self._config, feedback.position_rad
        if self._sign * feedback.torque_nm >= config.calib_tau_limit:
            return self._gains.at(position_rad), "found"
        command = self._gains.at(position_rad + self._sign * config.calib_step_rad)
        if self._sampled is None:
            self._sampled = (now_s, position_rad)
            return command, None
        since_s, from_rad = self._sampled
        if now_s - since_s < config.sample_interval * 0.999:
            return command, None
        self._sampled = (now_s, position_rad)
        self.iterations += 1
        still = abs(position_rad - from_rad) < config.calib_stall_delta
        self._still = self._still + 1 if still else 0
        if self._still >= config.calib_stall_cycles:
            return command, "found"
        return command, "not_found" if self.iterations >= config.calib_max_iter else None
