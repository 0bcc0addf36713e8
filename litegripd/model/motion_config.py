"""The tunables of the motions, by the names, defaults and meanings of the vendor's SDK."""

import math
from dataclasses import dataclass, fields

from litegripd.model.geometry import Geometry


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """How the jaws move; raises `ValueError`, naming the field, for a value out of its range.

    The units are in the names, or: `reach_tol`, `stall_delta`, `stop_tol` and `calib_step_rad`
    are radians; `sample_interval`, `settle_s` and `enable_retry_interval` seconds;
    `calib_tau_limit` N·m; `press_overshoot` a share of the travel; `stall_ratio` a share of the
    expected distance. The defaults are the vendor's, validated on the real gripper.
    """

    speed_mm_s: float = 50.0
    sample_interval: float = 0.05
    settle_s: float = 0.3
    reach_tol: float = 0.02
    stall_cycles: int = 5
    stall_ratio: float = 0.2
    stall_delta: float = 0.0015
    max_lead_mm: float = 4.0
    press_overshoot: float = 0.05
    press_zone_mm: float = 2.0
    stop_lead_mm: float = 0.7
    stop_tol: float = 0.02
    enable_retries: int = 3
    enable_retry_interval: float = 0.2
    calib_step_rad: float = 0.05
    calib_tau_limit: float = 2.0

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for field in fields(self):
            value = getattr(self, field.name)
            lowest, highest = RANGES[field.name]
            if not math.isfinite(value) or not lowest <= value <= highest:
                raise ValueError(f"{field.name} is {value}, it must be {lowest:g} to {highest:g}")


RANGES: dict[str, tuple[float, float]] = {
    "speed_mm_s": (0.1, 500.0),
    "sample_interval": (0.01, 1.0),
    "settle_s": (0.0, 5.0),
    "reach_tol": (0.001, 0.2),
    "stall_cycles": (1, 100),
    "stall_ratio": (0.01, 0.9),
    "stall_delta": (0.0001, 0.05),
    "max_lead_mm": (0.1, 6.0),
    "press_overshoot": (0.0, 0.2),
    "press_zone_mm": (0.0, 20.0),
    "stop_lead_mm": (0.1, 3.0),
    "stop_tol": (0.001, 0.2),
    "enable_retries": (1, 20),
    "enable_retry_interval": (0.02, 2.0),
    "calib_step_rad": (0.005, 0.1),
    "calib_tau_limit": (0.1, 3.0),
}
"""What each field may be, both ends included."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two settings that do not go together: which value is meant, and its limit."""

    field: str
    requested: float
    limit: float
    message: str


def move_conflict(
    config: MotionConfig, speed_mm_s: float, geometry: Geometry, period_s: float
) -> Conflict | None:
    """Say why a move to a stop at this speed does not go with the other settings, if so.

    Above `stop_lead_mm` a period, the lead cap would clip the ramp's own step. Below
    `stop_lead_mm` a stall window, static friction would count as a stall: it holds the jaws until
    the command leads by up to that much. Below `stall_delta` a window, every motion would. A
    target closer to the stop than `reach_tol` could not tell a stop from a jaw that met none.
    """
    overshoot_rad = config.press_overshoot * geometry.travel_rad
    if overshoot_rad <= config.reach_tol:
        needed = config.reach_tol / geometry.travel_rad
        return Conflict(
            "press_overshoot",
            config.press_overshoot,
            needed,
            f"press_overshoot {config.press_overshoot:g} of the calibrated travel is"
            f" {overshoot_rad:.3f} rad; it must be above reach_tol, {config.reach_tol:g} rad",
        )
    fastest = config.stop_lead_mm / period_s
    window_s = config.stall_cycles * config.sample_interval
    slowest = max(1.5 * config.stall_delta * geometry.rad_to_mm, config.stop_lead_mm) / window_s
    if not speed_mm_s <= fastest:  # so that NaN is refused, too
        return Conflict(
            "speed_mm_s",
            speed_mm_s,
            fastest,
            f"speed_mm_s is {speed_mm_s:g}, at most {fastest:g} goes with stop_lead_mm"
            f" {config.stop_lead_mm:g}: the command may not lead by less than one period's travel",
        )
    if speed_mm_s < slowest:
        return Conflict(
            "speed_mm_s",
            speed_mm_s,
            slowest,
            f"speed_mm_s is {speed_mm_s:g}, at least {slowest:.3g} goes with stop_lead_mm"
            f" {config.stop_lead_mm:g} and stall_delta {config.stall_delta:g} in a stall window of"
            f" {window_s:g} s: a slower motion could not be told from a stall",
        )
    return None
