"""The tunables of the motions, by the names, defaults and meanings of the vendor's SDK."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any


class MotionConfigError(ValueError):
    """A field that is unknown, of the wrong type or out of its range; `field` names it."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """How the jaws move; raises `MotionConfigError` for a value that its field cannot have.

    The units are in the names, or: `margin` and `press_overshoot` are shares of the travel,
    `stall_ratio` one of the expected distance; `reach_tol`, `stall_delta`, `stop_tol`,
    `calib_step_rad` and `calib_stall_delta` are radians; `hold_kp` and `calib_kp` N·m/rad,
    `hold_kd` and `calib_kd` N·m·s/rad; `calib_tau_limit` N·m; what ends in `_interval` is
    seconds. The defaults are the vendor's, validated on the real gripper; those of
    `force_rate_n_s` and `stop_torque_nm` to `stop_release_s` come from its use in the field. The
    vendor's `frame_interval` is the daemon's control period, and not among these.
    """

    speed_mm_s: float = 50.0
    grasp_speed_mm_s: float = 50.0
    margin: float = 0.05
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
    force_n: float = 20.0
    force_rate_n_s: float = 20.0
    hold_interval: float = 0.2
    hold_kp: float = 150.0
    hold_kd: float = 2.0
    stop_torque_nm: float = 0.7
    stop_torque_cycles: int = 3
    stop_release_s: float = 0.2
    enable_retries: int = 3
    enable_retry_interval: float = 0.2
    calib_kp: float = 20.0
    calib_kd: float = 2.0
    calib_step_rad: float = 0.05
    calib_tau_limit: float = 2.0
    calib_stall_delta: float = 0.0015
    calib_stall_cycles: int = 5
    calib_max_iter: int = 200

    def __post_init__(self) -> None:
        """Check each field by itself, and those that belong together."""
        for field in fields(self):
            _check(field.name, getattr(self, field.name))
        if self.stop_lead_mm > self.max_lead_mm:
            raise MotionConfigError(
                "stop_lead_mm",
                f"stop_lead_mm is {self.stop_lead_mm:g}, it must be at most max_lead_mm,"
                f" {self.max_lead_mm:g}: near the stop the jaws press less, not more",
            )

    def changed(self, values: Mapping[str, Any], period_s: float) -> "MotionConfig":
        """Return a copy with some fields changed, as a client asks for.

        `frame_interval` may be given, but only as it is: `period_s`. Raises `MotionConfigError`.
        """
        given = dict(values)
        interval_s = given.pop("frame_interval", None)
        if interval_s is not None and not _is_about(interval_s, period_s):
            raise MotionConfigError(
                "frame_interval",
                f"frame_interval is {period_s:g}, the daemon's control period, and read-only:"
                " rate_hz in the daemon's configuration sets it",
            )
        unknown = sorted(given.keys() - RANGES.keys())
        if unknown:
            known = ", ".join(("frame_interval", *RANGES))
            text = f"there is no field {unknown[0][:40]!r}; there are: {known}"
            raise MotionConfigError(unknown[0][:40], text)
        typed: dict[str, Any] = {name: _typed(name, value) for name, value in given.items()}
        return replace(self, **typed)

    def as_fields(self, period_s: float) -> dict[str, float]:
        """Return all fields, `frame_interval` included."""
        return {**asdict(self), "frame_interval": period_s}


RANGES: dict[str, tuple[float, float]] = {
    "speed_mm_s": (0.1, 500.0),
    "grasp_speed_mm_s": (0.1, 200.0),
    "margin": (0.0, 0.4),
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
    "force_n": (0.5, 30.0),
    "force_rate_n_s": (1.0, 200.0),
    "hold_interval": (0.005, 2.0),
    "hold_kp": (0.0, 300.0),
    "hold_kd": (0.1, 5.0),
    "stop_torque_nm": (0.3, 7.0),
    "stop_torque_cycles": (1, 100),
    "stop_release_s": (0.0, 2.0),
    "enable_retries": (1, 20),
    "enable_retry_interval": (0.02, 2.0),
    "calib_kp": (2.0, 100.0),
    "calib_kd": (0.2, 5.0),
    "calib_step_rad": (0.005, 0.1),
    "calib_tau_limit": (1.1, 3.0),
    "calib_stall_delta": (0.0002, 0.02),
    "calib_stall_cycles": (2, 100),
    "calib_max_iter": (10, 2000),
}
"""What each field may be, both ends included. 30 N is 3 N·m, what the DM4310 bears for long. With
less than 1.1 N·m a stop cannot be told from jaws that stick in front of it, by up to 0.95 N·m
(field use of the gripper)."""

_INTEGERS = frozenset(field.name for field in fields(MotionConfig) if field.type is int)


def _check(name: str, value: float) -> None:
    lowest, highest = RANGES[name]
    if not math.isfinite(value) or not lowest <= value <= highest:
        text = f"{name} is {value}, it must be {lowest:g} to {highest:g}"
        raise MotionConfigError(name, text)


def _typed(name: str, value: object) -> float:
    whole = name in _INTEGERS
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
        kind = "an integer" if whole else "a number"
        raise MotionConfigError(name, f"{name} is {value!r:.60}, it must be {kind}")
    if isinstance(value, int) and abs(value) > _LARGEST:
        raise MotionConfigError(name, f"{name} is too large")
    return value if whole else float(value)


_LARGEST = 10**9  # a larger integer is nonsense in every field, and may be too large for a float


def _is_about(value: object, period_s: float) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if isinstance(value, int) and abs(value) > _LARGEST:
        return False
    return abs(value - period_s) <= 1e-9
