"""Gains and lead by which a moving command stays within a torque, whatever the jaws meet."""

from litegripd.control.gains import Gains

DAMPING_SHARE = 0.4
LEAD_PERIODS = 3.0
"""The lead leaves room for what the jaws travel while a measurement is on its way."""
SOFTEST_KP_NM_RAD = 5.0


def budgeted(
    budget_nm: float, speed_rad_s: float, gains: Gains, period_s: float
) -> tuple[Gains, float]:
    """Return gains and the largest lead (rad) for a command that moves at `speed_rad_s`.

    Jaws that are stopped at once are pushed by kp·lead + kd·speed: that is the budget. Both gains
    are at most the given ones, so that the motion is no stiffer than without a budget.
    """
    kd = min(gains.kd_nm_s_rad, DAMPING_SHARE * budget_nm / speed_rad_s)
    left_nm = budget_nm - kd * speed_rad_s
    kp = max(gains.kp_nm_rad, SOFTEST_KP_NM_RAD)
    lead_rad = max(left_nm / kp, LEAD_PERIODS * speed_rad_s * period_s)
    return Gains(left_nm / lead_rad, kd), lead_rad
