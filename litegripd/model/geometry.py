"""From motor radians to jaw millimetres, openness and newtons, for either mount.

Only the calibrated limits decide which way the motor turns when the jaws close.
"""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

Mount: TypeAlias = Literal["normal", "reverse"]

LARGEST_LIMIT_RAD = 100.0
SMALLEST_TRAVEL_RAD = 0.001
RAD_TO_MM_RANGE = (0.001, 1e6)
"""Far wider than any gripper. Within these bounds no figure of the geometry over- or underflows."""

NOMINAL_RAD_TO_MM = 74.8
"""The scale of the vendor's templates."""

FORCE_PER_TORQUE_N_NM = 10.0
"""1 N corresponds to about 0.1 N·m (vendor's SDK, `UnitConversion.N_TO_NM`). The factor is
approximate: the clamping force depends on the geometry of the fingers."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """The calibrated travel of one gripper.

    `closed_rad` and `open_rad` are the motor's positions at the two stops, in either order;
    `rad_to_mm` is the jaw opening per radian, above 0. Raises `ValueError` for a value that is
    not finite, for zero travel, for a factor that is not positive, and for absurd sizes.
    """

    closed_rad: float
    open_rad: float
    rad_to_mm: float

    def __post_init__(self) -> None:
        """Reject limits that leave the closing direction unknown."""
        if not all(map(math.isfinite, (self.closed_rad, self.open_rad, self.rad_to_mm))):
            raise ValueError("a limit or rad_to_mm is not a finite number")
        if self.closed_rad == self.open_rad:
            raise ValueError("the two limits are equal, so the closing direction is unknown")
        if self.rad_to_mm <= 0.0:
            raise ValueError(f"rad_to_mm is {self.rad_to_mm}, it must be above 0")
        if max(abs(self.closed_rad), abs(self.open_rad)) > LARGEST_LIMIT_RAD:
            raise ValueError(f"a limit is beyond ±{LARGEST_LIMIT_RAD:g} rad")
        if self.travel_rad < SMALLEST_TRAVEL_RAD:
            raise ValueError(f"the travel is {self.travel_rad:g} rad, less than a jaw can move")
        if not RAD_TO_MM_RANGE[0] <= self.rad_to_mm <= RAD_TO_MM_RANGE[1]:
            raise ValueError(f"rad_to_mm is {self.rad_to_mm:g}, it must be 0.001 to 1e6")

    @property
    def close_sign(self) -> int:
        """+1 when closing increases radians, -1 otherwise."""
        return 1 if self.closed_rad > self.open_rad else -1

    @property
    def mount(self) -> Mount:
        """The mount: "normal" when closing increases radians, otherwise "reverse"."""
        return "normal" if self.close_sign > 0 else "reverse"

    @property
    def travel_rad(self) -> float:
        """The distance between the stops, above 0."""
        return abs(self.closed_rad - self.open_rad)

    @property
    def travel_mm(self) -> float:
        """The calibrated stroke."""
        return self.travel_rad * self.rad_to_mm

    def opening_mm(self, position_rad: float) -> float:
        """Return the opening: 0 at the closed stop, positive towards open."""
        return (self.closed_rad - position_rad) * self.close_sign * self.rad_to_mm

    def openness(self, position_rad: float) -> float:
        """Return the share of the travel that is open, 0 (closed) to 1 (open).

        Raises `ValueError` for a position that is not finite, before anything is clamped.
        """
        if not math.isfinite(position_rad):
            raise ValueError(f"the position is {position_rad}")
        return min(max(self.opening_mm(position_rad) / self.travel_mm, 0.0), 1.0)

    def position_rad(self, openness: float) -> float:
        """Return the motor's position for a share of the travel that is open."""
        return self.closed_rad - self.close_sign * openness * self.travel_rad

    def force_n(self, torque_nm: float) -> float:
        """Return the approximate force at the jaws; squeezing is positive."""
        return self.close_sign * torque_nm * FORCE_PER_TORQUE_N_NM

    def to_rad(self, distance_mm: float) -> float:
        """Return a distance of the jaws in radians, without direction."""
        return distance_mm / self.rad_to_mm
