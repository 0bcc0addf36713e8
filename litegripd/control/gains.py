"""Stiffness, damping and lead of position commands, and how a torque bounds them."""

from dataclasses import dataclass

from litegripd.model.calibration import Calibration
from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MitCommand

CALM_KD_NM_S_RAD = 1.0
"""Stable with a reserve of 1.4 on a motor that filters its speed by 2 ms, with a current loop of
1 ms and half the inertia: J·(1/T_filter + 1/T_current) is 1.4 there, and 2.8 with the whole
inertia. With more damping such motors shake as soon as something moves the jaws."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Stiffness and damping of position commands."""

    kp_nm_rad: float
    kd_nm_s_rad: float

    def at(self, position_rad: float, velocity_rad_s: float = 0.0) -> MitCommand:
        """Return the command for a position, without a torque of its own."""
        return MitCommand(position_rad, velocity_rad_s, self.kp_nm_rad, self.kd_nm_s_rad, 0.0)

    def calmed(self) -> "Gains":
        """Return these gains with no more damping than free jaws allow on every motor."""
        return Gains(self.kp_nm_rad, min(self.kd_nm_s_rad, CALM_KD_NM_S_RAD))


DEFAULT_GAINS = Gains(kp_nm_rad=100.0, kd_nm_s_rad=2.0)


def gains_of(calibration: Calibration, before: Gains) -> Gains:
    """Return a calibration's gains; one that it leaves out keeps its value from `before`."""
    kp, kd = calibration.kp_nm_rad, calibration.kd_nm_s_rad
    return Gains(
        before.kp_nm_rad if kp is None else kp,
        before.kd_nm_s_rad if kd is None else kd,
    )


def is_in_press_zone(short_rad: float, geometry: Geometry, config: MotionConfig) -> bool:
    """Return True if jaws `short_rad` short of the stop must press gently from now on."""
    return short_rad <= geometry.to_rad(config.press_zone_mm)


def max_lead_rad(short_rad: float, geometry: Geometry, config: MotionConfig) -> float:
    """Return the largest lead (rad) for jaws that are `short_rad` short of the stop ahead."""
    pressing = is_in_press_zone(short_rad, geometry, config)
    return geometry.to_rad(config.stop_lead_mm if pressing else config.max_lead_mm)


def clamp_lead(wanted_rad: float, position_rad: float, lead_rad: float) -> float:
    """Return the position nearest to the wanted one that leads the jaws by at most `lead_rad`."""
    return min(max(wanted_rad, position_rad - lead_rad), position_rad + lead_rad)


DAMPING_SHARE = 0.4
LEAD_PERIODS = 3.0
"""The lead must cover what the jaws travel while a measurement is on its way."""
SOFTEST_KP_NM_RAD = 5.0


def budgeted(
    budget_nm: float, speed_rad_s: float, gains: Gains, period_s: float
) -> tuple[Gains, float]:
    """Return gains and the largest lead (rad) for a command that moves at `speed_rad_s`.

    Jaws that are stopped at once are pushed by kp·lead + kd·speed, which is the budget. Both gains
    are at most the given ones, so that the motion is no stiffer than without a budget.
    """
    kd = min(gains.kd_nm_s_rad, DAMPING_SHARE * budget_nm / speed_rad_s)
    left_nm = budget_nm - kd * speed_rad_s
    kp = max(gains.kp_nm_rad, SOFTEST_KP_NM_RAD)
    lead_rad = max(left_nm / kp, LEAD_PERIODS * speed_rad_s * period_s)
    return Gains(left_nm / lead_rad, kd), lead_rad
