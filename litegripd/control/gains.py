"""Stiffness and damping of position commands."""

from dataclasses import dataclass

from litegripd.model.calibration import Calibration
from litegripd.model.motor import MitCommand

CALM_KD_NM_S_RAD = 1.0
"""Stable with a reserve of 1.4 on a motor that filters its speed by 2 ms, with a current loop of
1 ms and half the inertia: J·(1/T_filter + 1/T_current) is 1.4 there, and 2.8 with the whole
inertia. More damping shakes on such motors as soon as something moves the jaws."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Stiffness and damping of position commands."""

    kp_nm_rad: float
    kd_nm_s_rad: float

    def at(self, position_rad: float, velocity_rad_s: float = 0.0) -> MitCommand:
        """Return the command that goes to a position, without torque of its own."""
        return MitCommand(position_rad, velocity_rad_s, self.kp_nm_rad, self.kd_nm_s_rad, 0.0)

    def calmed(self) -> "Gains":
        """Return these gains with no more damping than free jaws bear on every motor."""
        return Gains(self.kp_nm_rad, min(self.kd_nm_s_rad, CALM_KD_NM_S_RAD))


DEFAULT_GAINS = Gains(kp_nm_rad=100.0, kd_nm_s_rad=2.0)


def gains_of(calibration: Calibration, before: Gains) -> Gains:
    """Return a calibration's gains; one that it does not give, as a template does not, stays."""
    kp, kd = calibration.kp_nm_rad, calibration.kd_nm_s_rad
    return Gains(
        before.kp_nm_rad if kp is None else kp,
        before.kd_nm_s_rad if kd is None else kd,
    )
