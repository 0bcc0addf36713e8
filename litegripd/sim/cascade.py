"""The loops of the control modes 2 to 4: from a position or a speed to a torque.

Position to speed, speed to torque, one inside the other, as the family's motors have them. The
registers' names and ids are the maker's; how they enter the loops is an estimate, because the maker
does not say it:

- KP_APR turns a position error (rad) into a speed (rad/s), at most the commanded one, MAX_SPD, and
  what DEC can still stop. KI_APR is held and does nothing.
- The speed that is aimed at changes by at most ACC, or DEC towards standstill, both in rad/s².
- KP_ASR and KI_ASR are gains of the speed error at the rotor, in N·m·s/rad and N·m/rad; at the
  output they are Gr² times as large.

It computes the law's figures once in `PERIOD_STEPS` steps; `plant` follows them in every step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from litegripd.sim import registers as reg
from litegripd.sim.codec import SetPoint
from litegripd.sim.plant import STEP_S

PERIOD_STEPS = 4
"""The loops run every 1 ms."""

_PERIOD_S = PERIOD_STEPS * STEP_S


class SpeedLaw(NamedTuple):
    """The law kd·(dq - dq_measured) + tau for the time until the next step."""

    velocity_rad_s: float
    kd_nm_s_rad: float
    torque_nm: float


class Cascade:
    """The loops of one motor, with what they remember."""

    def __init__(self, registers: reg.Registers) -> None:
        self._registers = registers
        self.reset(0.0)

    def reset(self, velocity_rad_s: float) -> None:
        """Forget the past; begin at this speed."""
        self._aim_rad_s = velocity_rad_s
        self._integral_nm = 0.0

    def step(
        self, set_point: SetPoint, *, position_rad: float, velocity_rad_s: float, most_nm: float
    ) -> SpeedLaw:
        """Advance by 1 ms at the measured position and speed.

        The integral holds at most `most_nm`, which is what the motor may make.
        """
        gear = self._registers[reg.GR] ** 2
        self._approach(self._wanted_speed(set_point, position_rad))
        error_rad_s = self._aim_rad_s - velocity_rad_s
        integral = self._integral_nm + gear * self._registers[reg.KI_ASR] * error_rad_s * _PERIOD_S
        self._integral_nm = min(max(integral, -most_nm), most_nm)
        return SpeedLaw(self._aim_rad_s, gear * self._registers[reg.KP_ASR], self._integral_nm)

    def _wanted_speed(self, set_point: SetPoint, position_rad: float) -> float:
        most = self._registers[reg.MAX_SPD]
        if set_point.position_rad is None:
            return min(max(set_point.velocity_rad_s, -most), most)
        error_rad = set_point.position_rad - position_rad
        stoppable = math.sqrt(2.0 * -self._registers[reg.DEC] * abs(error_rad))
        most = min(most, abs(set_point.velocity_rad_s), stoppable)
        return min(max(self._registers[reg.KP_APR] * error_rad, -most), most)

    def _approach(self, wanted_rad_s: float) -> None:
        """Let the speed that is aimed at change as ACC and DEC allow."""
        aim = self._aim_rad_s
        is_slowing = abs(wanted_rad_s) < abs(aim) or wanted_rad_s * aim < 0.0
        rate = -self._registers[reg.DEC] if is_slowing else self._registers[reg.ACC]
        change = rate * _PERIOD_S
        self._aim_rad_s += min(max(wanted_rad_s - aim, -change), change)
