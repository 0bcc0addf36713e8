"""Which settings of a motion do not go together, for a given travel and control period."""

from dataclasses import dataclass

from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import MotionConfig


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two settings that do not go together: which value is meant, and its limit."""

    field: str
    requested: float
    limit: float
    message: str


LEAST_DAMPING_S = 2e-3
"""Of kd / kp. The motor's torque follows its command by 1 ms or more, so stiffness alone feeds each
swing: a usual motor swings for ever below 0.5 (100 N·m/rad) to 1.5 ms (500 N·m/rad)."""


def damping_conflict(kp_nm_rad: float, kd_nm_s_rad: float, of: str = "") -> Conflict | None:
    """Report that gains of a position command damp too little to be safe, if so.

    `kp_nm_rad` in N·m/rad, `kd_nm_s_rad` in N·m·s/rad; `of` is what their names begin with. Enough
    damping does not make every motor calm.
    """
    least = LEAST_DAMPING_S * kp_nm_rad
    if kd_nm_s_rad >= least * (1.0 - 1e-9):
        return None
    return Conflict(
        f"{of}kd",
        kd_nm_s_rad,
        least,
        f"{of}kd is {kd_nm_s_rad:g}, with {of}kp {kp_nm_rad:g} it must be at least {least:.3g}:"
        " with less damping the jaws swing by themselves",
    )


def move_conflict(
    config: MotionConfig, speed_mm_s: float, geometry: Geometry, period_s: float
) -> Conflict | None:
    """Say why a move to a stop at this speed does not go with the other settings, if so.

    A target closer to the stop than `reach_tol` could not tell a stop from a jaw that met none.
    """
    overshoot_rad = config.press_overshoot * geometry.travel_rad
    if overshoot_rad <= config.reach_tol:
        return Conflict(
            "press_overshoot",
            config.press_overshoot,
            config.reach_tol / geometry.travel_rad,
            f"press_overshoot {config.press_overshoot:g} of the calibrated travel is"
            f" {overshoot_rad:.3f} rad; it must be above reach_tol, {config.reach_tol:g} rad",
        )
    return fast_conflict(config, speed_mm_s, period_s) or slow_conflict(
        config, speed_mm_s, geometry, "speed_mm_s"
    )


def fast_conflict(config: MotionConfig, speed_mm_s: float, period_s: float) -> Conflict | None:
    """Say why a speed is too high, if so: the lead cap would clip the ramp's own step."""
    fastest = config.stop_lead_mm / period_s
    if speed_mm_s <= fastest:  # not so for NaN
        return None
    return Conflict(
        "speed_mm_s",
        speed_mm_s,
        fastest,
        f"speed_mm_s is {speed_mm_s:g}, at most {fastest:g} goes with stop_lead_mm"
        f" {config.stop_lead_mm:g}: the command may not lead by less than one period's travel",
    )


def slow_conflict(
    config: MotionConfig, speed_mm_s: float, geometry: Geometry, field: str
) -> Conflict | None:
    """Say why a speed is too low for the stall window, if so.

    Below `stop_lead_mm` a window, static friction would count as a stall: it holds the jaws until
    the command leads by up to that much. Below `stall_delta` a window, every motion would.
    """
    window_s = config.stall_cycles * config.sample_interval
    slowest = max(1.5 * config.stall_delta * geometry.rad_to_mm, config.stop_lead_mm) / window_s
    if speed_mm_s >= slowest:
        return None
    return Conflict(
        field,
        speed_mm_s,
        slowest,
        f"{field} is {speed_mm_s:g}, at least {slowest:.3g} goes with stop_lead_mm"
        f" {config.stop_lead_mm:g} and stall_delta {config.stall_delta:g} in a stall window of"
        f" {window_s:g} s: a slower motion could not be told from a stall",
    )
