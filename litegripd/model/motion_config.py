"""The motion configuration: each field, its range, and which values must fit together."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from typing import Any

from litegripd.model.errors import as_typed, at_least, at_most, unit_of
from litegripd.model.gripper import DM4310, FASTEST_MM_S, MOTOR_TYPES, Geometry, MotorType
from litegripd.model.sentence import parameter_name, sentence


class MotionConfigError(ValueError):
    """A field that is unknown, of the wrong type or out of its range; `field` names it."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


PRESS_NM_PER_MM = 100.0 / 74.8
"""The torque for each mm of a lead in the settings. The vendor's lead of 0.7 mm presses with 0.94
N·m at its kp 100 and 74.8 mm/rad; that torque is what was found right. With other gains or another
scale the same lead would press with anything from 0.05 to 9 N·m. So the settings keep the vendor's
names and values, and mean these torques whatever a calibration says."""
MOST_PUSH_NM = 2.0
"""No motion pushes harder by itself. Jaws that something has held with this torque, and lets go,
have 8 mJ before the motor's current follows its damping; with the 5.35 N·m of the vendor's lead
they had 49. Friction takes up to 1.4 N·m (field use, random plants), so less would not do."""
NEEDED_NM_S_MM = MOST_PUSH_NM / FASTEST_MM_S
"""The torque that a lead needs for each mm/s: friction, and what the jaws travel while they are
measured. At 150 mm/s they stopped on the way with 0.67 and 0.94 N·m (100 and 200 Hz), and with
1.07 were thrown at 184 mm/s (1000 Hz), for the command waits and begins again; with 2 at 167."""
REACHING_KP_NM_RAD = 55.0
"""With less, friction keeps the jaws away from a target by more than `reach_tol`: 1.1 N·m on 0.02
rad."""
MOVING_KP_NM_RAD = 100.0
MOVING_KD_NM_S_RAD = 2.0
"""Stiffness and damping of motions whose caller names none (the vendor's, validated on the real
gripper)."""


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """How the jaws move; raises `MotionConfigError` for a value that its field cannot have.

    The units are in the names, or: `margin` and `press_overshoot` are shares of the travel,
    `stall_ratio` one of the expected distance; `reach_tol`, `stall_delta`, `stop_tol`,
    `calib_step_rad` and `calib_stall_delta` are radians; `hold_kp` and `calib_kp` N·m/rad,
    `hold_kd` and `calib_kd` N·m·s/rad; `calib_tau_limit` N·m; what ends in `_interval` is
    seconds. The defaults are the vendor's, validated on the real gripper; those of
    `force_rate_n_s` and `stop_torque_nm` to `stop_release_s` come from its use in the field. The
    vendor's `frame_interval` is the daemon's control period, and not among these. `max_lead_mm` and
    `stop_lead_mm` are bounds of a torque, `PRESS_NM_PER_MM` for each mm.
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
        """Check each field by itself, and those that must fit together."""
        for field in fields(self):
            _check(field.name, getattr(self, field.name), WIDEST)
        if self.stop_lead_mm > self.max_lead_mm:
            raise MotionConfigError(
                "stop_lead_mm",
                f"stop_lead_mm is {self.stop_lead_mm:g}, it must be at most max_lead_mm,"
                f" {self.max_lead_mm:g}: near the stop the jaws press less, not more",
            )

    @property
    def travel_nm(self) -> float:
        """The largest torque of a lead on the way: `max_lead_mm` in N·m, `MOST_PUSH_NM` at most."""
        return min(self.max_lead_mm * PRESS_NM_PER_MM, MOST_PUSH_NM)

    def travel_nm_at(self, speed_mm_s: float) -> float:
        """Return the largest torque of a lead at a speed: at least what moves jaws that fast."""
        return min(max(self.travel_nm, NEEDED_NM_S_MM * speed_mm_s), MOST_PUSH_NM)

    @property
    def stop_nm(self) -> float:
        """The torque that presses on a stop: `stop_lead_mm` in N·m, `MOST_PUSH_NM` at most."""
        return min(self.stop_lead_mm * PRESS_NM_PER_MM, MOST_PUSH_NM)

    def changed(
        self, values: Mapping[str, Any], period_s: float, motor_type: MotorType = DM4310
    ) -> "MotionConfig":
        """Return a copy with the fields that a client changed, within the motor's ranges.

        `frame_interval` may be given, but only with its present value, `period_s`. Raises
        `MotionConfigError`.
        """
        given = dict(values)
        interval_s = given.pop("frame_interval", None)
        if interval_s is not None and not _is_about(interval_s, period_s):
            raise MotionConfigError(
                "frame_interval",
                f"frame_interval is {period_s:g}, the daemon's control period, and read-only:"
                " rate_hz in the daemon's configuration sets it",
            )
        unknown = sorted(given.keys() - _RANGES.keys())
        if unknown:
            known = ", ".join(("frame_interval", *_RANGES))
            text = f"there is no field {unknown[0][:40]!r}; there are: {known}"
            raise MotionConfigError(unknown[0][:40], text)
        typed: dict[str, Any] = {name: _typed(name, value) for name, value in given.items()}
        ranges = ranges_of(motor_type)
        for name in (field.name for field in fields(self) if field.name in typed):
            _check(name, typed[name], ranges)
        return replace(self, **typed)

    def as_fields(self, period_s: float) -> dict[str, float]:
        """Return all fields, `frame_interval` included."""
        return {**asdict(self), "frame_interval": period_s}


_RANGES: dict[str, tuple[float, float]] = {
    "speed_mm_s": (0.1, FASTEST_MM_S),
    "grasp_speed_mm_s": (0.1, FASTEST_MM_S),
    "margin": (0.0, 0.95),
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
    "force_n": (0.5, math.inf),
    "force_rate_n_s": (1.0, 200.0),
    "hold_interval": (0.005, 2.0),
    "hold_kp": (0.0, 300.0),
    "hold_kd": (0.1, 5.0),
    "stop_torque_nm": (0.3, math.inf),
    "stop_torque_cycles": (1, 100),
    "stop_release_s": (0.0, 2.0),
    "enable_retries": (1, 20),
    "enable_retry_interval": (0.02, 2.0),
    "calib_kp": (2.0, 100.0),
    "calib_kd": (0.2, 5.0),
    "calib_step_rad": (0.005, 0.1),
    "calib_tau_limit": (1.1, math.inf),
    "calib_stall_delta": (0.0002, 0.02),
    "calib_stall_cycles": (2, 100),
    "calib_max_iter": (10, 2000),
}
"""The range of each field, both ends included, as far as the motor allows. With less than 1.1
N·m a stop looks like jaws that stick in front of it, which takes up to 0.95 N·m (field use)."""


@cache
def ranges_of(motor_type: MotorType) -> Mapping[str, tuple[float, float]]:
    """Return the range of each field with a type of motor: no more than it can do for long."""
    most = {
        "force_n": motor_type.most_force_n,
        "stop_torque_nm": motor_type.peak_nm,
        "calib_tau_limit": motor_type.rated_nm,
    }
    return {name: (low, min(high, most.get(name, high))) for name, (low, high) in _RANGES.items()}


WIDEST: Mapping[str, tuple[float, float]] = {
    name: (low, max(ranges_of(row)[name][1] for row in MOTOR_TYPES.values()))
    for name, (low, _high) in _RANGES.items()
}
"""The range of each field that some type of motor allows."""

_INTEGERS = frozenset(field.name for field in fields(MotionConfig) if field.type is int)


def _check(name: str, value: float, ranges: Mapping[str, tuple[float, float]]) -> None:
    lowest, highest = ranges[name]
    if not math.isfinite(value) or not lowest <= value <= highest:
        text = f"{name} is {as_typed(value)}, it must be {lowest:g} to {highest:g}{unit_of(name)}"
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


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two settings that do not fit together: the value in question, and its limit."""

    field: str
    requested: float
    limit: float
    message: str


LEAST_DAMPING_S = 2e-3
"""The smallest kd / kp. The motor's torque follows its command by 1 ms or more, so stiffness
alone feeds each swing: a usual motor swings for ever below 0.5 (100 N·m/rad) to 1.5 ms (500
N·m/rad)."""


def damping_conflict(kp_nm_rad: float, kd_nm_s_rad: float, of: str = "") -> Conflict | None:
    """Return a conflict if the gains of a position command damp too little to be safe.

    `kp_nm_rad` is in N·m/rad, `kd_nm_s_rad` in N·m·s/rad; `of` is the prefix of their names. Enough
    damping does not make every motor calm.
    """
    least = LEAST_DAMPING_S * kp_nm_rad
    if kd_nm_s_rad >= least * (1.0 - 1e-9):
        return None
    return Conflict(
        f"{of}kd",
        kd_nm_s_rad,
        least,
        f"{of}kd is {kd_nm_s_rad:g}, with {of}kp {kp_nm_rad:g} it must be at least"
        f" {at_least(least, 3)}: with less damping the jaws swing by themselves",
    )


def move_conflict(
    config: MotionConfig, speed_mm_s: float, geometry: Geometry, motor_type: MotorType
) -> Conflict | None:
    """Return why a move to a stop at this speed does not fit the other settings, or None.

    With a target closer to the stop than `reach_tol`, a stop looks like a jaw that met none.
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
    return fast_conflict(speed_mm_s, geometry, motor_type) or slow_conflict(
        config, speed_mm_s, geometry, "speed_mm_s"
    )


def fastest_mm_s(geometry: Geometry, motor_type: MotorType) -> float:
    """Return the highest speed of any motion: in mm/s, and in rad/s at the motor."""
    return min(FASTEST_MM_S, motor_type.fastest_rad_s * geometry.rad_to_mm)


def fast_conflict(
    speed_mm_s: float, geometry: Geometry, motor_type: MotorType, field: str = "speed_mm_s"
) -> Conflict | None:
    """Return why a speed is too high, or None.

    A wrong scale cannot make the jaws faster: the bound at the motor knows no millimetres.
    """
    most_mm_s = fastest_mm_s(geometry, motor_type)
    if speed_mm_s <= most_mm_s:  # not so for NaN
        return None
    because = ""
    if most_mm_s < FASTEST_MM_S:
        because = (
            f": the motor turns at no more than {motor_type.fastest_rad_s:g} rad/s, and the"
            f" calibration has {geometry.rad_to_mm:.4g} mm/rad"
        )
    text = sentence(
        "{field} is {speed_mm_s:g}, it must be at most {most}{because}",
        field=parameter_name(field),
        speed_mm_s=speed_mm_s,
        most=at_most(most_mm_s, 4),
        because=because,
    )
    return Conflict(field, speed_mm_s, most_mm_s, text)


def slow_conflict(
    config: MotionConfig, speed_mm_s: float, geometry: Geometry, field: str
) -> Conflict | None:
    """Return why a speed is too low for the stall window, or None.

    Static friction holds the jaws until the command leads by up to `stop_lead_mm` in torque: in a
    window in which a slower command does not get so far, it would count as a stall. Below
    `stall_delta` a window, every motion would.
    """
    window_s = config.stall_cycles * config.sample_interval
    lead_rad = config.stop_nm / MOVING_KP_NM_RAD
    slowest = max(1.5 * config.stall_delta, lead_rad) * geometry.rad_to_mm / window_s
    if speed_mm_s >= slowest:
        return None
    return Conflict(
        field,
        speed_mm_s,
        slowest,
        sentence(
            "{field} is {speed_mm_s:g}, at least {slowest} goes with stop_lead_mm {lead_mm:g} and"
            " stall_delta {delta:g} in a stall window of {window_s:g} s: a slower motion would look"
            " like a stall",
            field=parameter_name(field),
            speed_mm_s=speed_mm_s,
            slowest=at_least(slowest, 3),
            lead_mm=config.stop_lead_mm,
            delta=config.stall_delta,
            window_s=window_s,
        ),
    )
