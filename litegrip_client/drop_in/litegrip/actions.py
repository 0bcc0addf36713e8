"""The six actions, their results and tunables, and the targets that they aim at."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ._shortened import shortened
from .exceptions import CommandError
from .models import CalibrationData, GripperConfig, GripperState

if TYPE_CHECKING:
    from .gripper import LiteGrip

__all__ = [
    "EnableResult",
    "GraspResult",
    "GripperActions",
    "MotionConfig",
    "MoveProgress",
    "MoveResult",
    "WriteZeroResult",
    "force_approach_terms",
    "limit_target",
    "press_target",
    "work_limit_target",
]

_LEAST_TRAVEL_RAD = 1e-6


@dataclass
class MotionConfig:
    """The tunables of a program's motions; each action reads them at its begin.

    Units are in the names; `reach_tol` and `stop_tol` are rad, `press_safety` a share. `hold_kp`
    and `hold_kd` are without effect. `sleep_fn` and `monotonic_fn` are kept and never called: the
    motion runs in the daemon, by its clock.
    """

    speed_mm_s: float = 50.0
    grasp_speed_mm_s: float = 50.0
    margin: float = 0.05
    frame_interval: float = 0.005
    sample_interval: float = 0.05
    settle_s: float = 0.3
    reach_tol: float = 0.02
    press_overshoot: float = 0.05
    press_zone_mm: float = 2.0
    stop_lead_mm: float = 0.7
    stop_tol: float = 0.02
    stall_cycles: int = 5
    stall_ratio: float = 0.2
    stall_delta: float = 0.0015
    max_lead_mm: float = 4.0
    press_safety: float = 0.9
    stop_torque_nm: float = 0.7
    stop_torque_cycles: int = 3
    stop_speed_ratio: float = 0.5
    stop_release_s: float = 0.2
    force_n: float = 20.0
    force_ramp_n_s: float = 20.0
    hold_interval: float = 0.2
    hold_kp: float = 150.0
    hold_kd: float = 2.0
    enable_retries: int = 3
    enable_retry_interval: float = 0.2
    calib_kp: float = 20.0
    calib_kd: float = 2.0
    calib_step_rad: float = 0.05
    calib_tau_limit: float = 2.0
    calib_stall_delta: float = 0.0015
    calib_stall_cycles: int = 5
    calib_max_iter: int = 200
    sleep_fn: Callable[[float], None] = field(default=time.sleep, repr=False, compare=False)
    monotonic_fn: Callable[[], float] = field(default=time.monotonic, repr=False, compare=False)


@dataclass
class MoveProgress:
    """How far an action is: frame `i` of `total_steps` on the way ("move"), slice `i` of a "hold".

    `delta_rad` is since the sample before; `win_delta_rad` since `stall_cycles` samples before,
    None until there are so many.
    """

    phase: str
    i: int
    total_steps: int
    cmd_rad: float
    pos_rad: float
    delta_rad: float
    win_delta_rad: float | None
    torque_nm: float
    temperature_coil: int = 0


@dataclass
class MoveResult:
    """How `open` or `close` ended; true if it did what it should."""

    ok: bool
    reached: bool
    stalled: bool
    state: GripperState
    target_rad: float
    limit_rad: float
    final_cmd_rad: float
    steps: int
    protected: bool = False

    def __bool__(self) -> bool:
        return self.ok


@dataclass
class GraspResult:
    """How a grasp ended; true if its hold did, without a fault. `cycles` are slices of the hold."""

    ok: bool
    reached: bool
    stalled: bool
    state: GripperState
    target_rad: float
    force_n: float
    cycles: int

    def __bool__(self) -> bool:
        return self.ok


@dataclass
class EnableResult:
    """Whether the motor is enabled, what it then said, and after how many tries."""

    ok: bool
    state: GripperState | None
    tries: int

    def __bool__(self) -> bool:
        return self.ok


@dataclass
class WriteZeroResult:
    """The angle before and after the motor's zero was set."""

    before_rad: float
    after_rad: float
    tolerance_rad: float = 1e-3

    @property
    def ok(self) -> bool:
        """True if the motor now counts from here."""
        return abs(self.after_rad) <= self.tolerance_rad

    def __bool__(self) -> bool:
        return self.ok


def limit_target(
    config: GripperConfig, toward: str, margin: float
) -> tuple[float, float, float, float]:
    """Return target, limit, offset and travel (rad): a share `margin` of the travel inside it."""
    return _target(config, toward, margin, inside=True)


def press_target(
    config: GripperConfig, toward: str, overshoot: float
) -> tuple[float, float, float, float]:
    """Return target, limit, offset and travel (rad): a share `overshoot` of the travel past it."""
    return _target(config, toward, overshoot, inside=False)


def _target(
    config: GripperConfig, toward: str, share: float, *, inside: bool
) -> tuple[float, float, float, float]:
    travel_rad = _travel_rad(config)
    offset_rad = share * travel_rad
    closes = toward == "close"
    limit_rad = config.pos_closed_rad if closes else config.pos_open_rad
    sign = config.close_sign if closes != inside else -config.close_sign
    return limit_rad + sign * offset_rad, limit_rad, offset_rad, travel_rad


def work_limit_target(config: GripperConfig, work_stroke_mm: float) -> tuple[float, float, float]:
    """Return target, open limit and way (rad) of an opening, which stays inside the travel."""
    travel_mm = _travel_rad(config) * config.rad_to_mm
    work_rad = min(max(work_stroke_mm, 0.0), travel_mm) / config.rad_to_mm
    return config.pos_closed_rad - config.close_sign * work_rad, config.pos_open_rad, work_rad


def _travel_rad(config: GripperConfig) -> float:
    """Return the travel; raises `CommandError` where there is none."""
    travel_rad = abs(config.pos_open_rad - config.pos_closed_rad)
    if not config.calibrated:
        raise CommandError("not calibrated: load_calibration(), load_template(name) or zero()")
    if travel_rad <= _LEAST_TRAVEL_RAD:
        raise CommandError(
            f"zero travel: the limits are {config.pos_closed_rad:g} rad closed and"
            f" {config.pos_open_rad:g} rad open; load a calibration, or zero()"
        )
    return travel_rad


def force_approach_terms(
    kp: float,
    kd: float,
    speed_rad_s: float,
    frame_interval: float,
    budget_nm: float,
    lead_ceiling_rad: float,
) -> tuple[float, float, float]:
    """Return speed (rad/s), damping and lead (rad) with which an approach presses a torque at most.

    Of the torque `budget_nm` a frame's way takes kp · speed · dt, the speed kd · speed; what is
    left bounds the lead. The daemon approaches by rules of its own (docs/grasping.md).
    """
    if budget_nm <= 0.0 or kp <= 0.0 or speed_rad_s <= 0.0:
        return speed_rad_s, kd, lead_ceiling_rad
    speed = min(speed_rad_s, budget_nm / (kp * frame_interval))
    way_rad = speed * frame_interval
    damping = min(max((budget_nm - kp * way_rad) / speed, 0.0), kd)
    lead_rad = min(lead_ceiling_rad, max(way_rad, (budget_nm - damping * speed) / kp))
    return speed, damping, lead_rad


@shortened
class GripperActions:
    """The six actions of a gripper, and `config`, which is its `motion_config`."""

    def __init__(self, gripper: LiteGrip, config: MotionConfig | None = None) -> None:
        self._gripper = gripper
        if config is not None:
            gripper.motion_config = config

    @property
    def config(self) -> MotionConfig:
        """The tunables of the motions: the gripper's `motion_config`."""
        return self._gripper.motion_config

    @config.setter
    def config(self, value: MotionConfig) -> None:
        self._gripper.motion_config = value

    def open(
        self,
        speed_mm_s: float | None = None,
        *,
        progress: Callable[[MoveProgress], None] | None = None,
    ) -> MoveResult:
        """Open, as `LiteGrip.open` does."""
        return self._gripper.open(speed_mm_s, progress=progress)

    def close(
        self,
        speed_mm_s: float | None = None,
        *,
        progress: Callable[[MoveProgress], None] | None = None,
    ) -> MoveResult:
        """Close, as `LiteGrip.close` does."""
        return self._gripper.close(speed_mm_s, progress=progress)

    def grasp(
        self,
        force_n: float | None = None,
        hold_s: float = 0.0,
        *,
        progress: Callable[[MoveProgress], None] | None = None,
    ) -> GraspResult:
        """Grasp, as `LiteGrip.grasp` does."""
        return self._gripper.grasp(force_n, hold_s, progress=progress)

    def zero(self) -> CalibrationData:
        """Measure the travel, as `LiteGrip.zero` does."""
        return self._gripper.zero()

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor, as `LiteGrip.enable` does."""
        return self._gripper.enable(retries)

    def disable(self) -> bool:
        """Disable the motor, as `LiteGrip.disable` does."""
        return self._gripper.disable()
