"""What a gripper is: its name on this machine, the motors of its family, and its geometry."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Literal, TypeAlias

from litegrip_client.values.trajectory_format import MOST_FORCE_N
from litegripd.model.motor import Ranges

Mount: TypeAlias = Literal["normal", "reverse"]

LARGEST_LIMIT_RAD = 100.0
SMALLEST_TRAVEL_RAD = 0.001
RAD_TO_MM_RANGE = (0.001, 1e6)
"""Far wider than any gripper. Within these bounds no figure of the geometry over- or underflows."""

STROKE_MM = 85.0
"""How far the jaws of the gripper that ships open, by a caliper (vendor's newest sources)."""
SPAN_INSET_MM = 1.0
"""A probe presses this far into the open stop. So the two limits span the stroke and this (vendor's
`SPAN_INSET_MM`)."""
STROKE_RANGE_MM = (1.0, 1000.0)
SUPERSEDED_STROKE_MM = 120.0
"""The stroke that earlier versions assumed: a placeholder, by its vendor's own word."""

FORCE_PER_TORQUE_N_NM = 10.0
"""1 N corresponds to about 0.1 N·m (vendor's SDK, `UnitConversion.N_TO_NM`): what a calibration has
unless its file says otherwise. It was never measured. By virtual work without friction, both
fingers together squeeze with 1000 / `rad_to_mm`: 19 N per N·m at 52.69 mm/rad. So it errs towards
more force than it says."""
NM_TO_N_RANGE = (5.0, 30.0)
"""What a calibration may have instead: virtual work gives 12.5 to 22 for the scales that were
seen."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """The calibrated travel of one gripper.

    `closed_rad` and `open_rad` are the motor's positions at the two stops, in either order;
    `rad_to_mm` is the jaw opening per radian, above 0. `nm_to_n` is the squeezing force per torque
    of the motor, approximately. Raises `ValueError` for a value that is not finite, for zero
    travel, for a factor that is not positive, and for absurd sizes.
    """

    closed_rad: float
    open_rad: float
    rad_to_mm: float
    nm_to_n: float = FORCE_PER_TORQUE_N_NM

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
        if not NM_TO_N_RANGE[0] <= self.nm_to_n <= NM_TO_N_RANGE[1]:
            low, high = NM_TO_N_RANGE
            raise ValueError(f"nm_to_n is {self.nm_to_n:g}, it must be {low:g} to {high:g}")

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
        return self.close_sign * torque_nm * self.nm_to_n

    def torque_nm(self, force_n: float) -> float:
        """Return the torque for a force, without direction."""
        return force_n / self.nm_to_n

    def to_rad(self, distance_mm: float) -> float:
        """Return a distance of the jaws in radians, without direction."""
        return distance_mm / self.rad_to_mm


PEAK_S = 0.5
"""How long the peak torque is allowed; less torque is allowed for longer."""

FINGERS_KG_M2 = 5e-5
"""Inertia of the gripper's fingers at the motor's output: 2 x 35.45 g at 26 mm/rad each (from its
model files)."""

FASTEST_MM_S = 150.0
"""The highest speed that may be asked for (vendor's newest programs)."""
FASTEST_RAD_S = 2.9
"""The same at the motor, whatever a calibration says of millimetres. Jaws overshoot by an eighth at
most: then the DM4310's rotor and the fingers have 10 mJ (1.85e-3 kg·m² at 3.3 rad/s). It is 150
mm/s at 51.7 mm/rad; the newest file that ships has 52.69."""


@dataclass(frozen=True)
class MotorType:
    """One type of motor. Torques, speeds and inertias are at the output, after the gear.

    `ranges` are those of a frame as the motor leaves the factory; the motor's own are used.
    `rated_nm` is allowed for long, `holding_nm` to a grip, for as long as the coil's heat allows
    it, and `peak_nm` for `PEAK_S`. At `coil_limit_c` the daemon lowers the torque; it is well below
    the firmware's own limit. `braking_nm_s_rad` is that of a disabled motor.
    """

    name: str
    is_untried: bool
    ranges: Ranges
    gear_ratio: float
    rated_nm: float
    holding_nm: float
    peak_nm: float
    rated_speed_rad_s: float
    no_load_speed_rad_s: float
    rotor_inertia_kg_m2: float
    breakaway_nm: float
    coulomb_nm: float
    viscous_nm_s_rad: float
    braking_nm_s_rad: float
    torque_constant_nm_a: float
    current_limit_a: float
    phase_resistance_ohm: float
    winding_k_w: float
    winding_s: float
    housing_k_w: float
    housing_s: float
    coil_limit_c: float = 80.0

    @cached_property
    def most_nm(self) -> float:
        """The torque at the current limit."""
        return self.torque_constant_nm_a * self.current_limit_a

    @cached_property
    def watts_per_nm2(self) -> float:
        """The loss of three phases: 1.5·R·I² at an amplitude I."""
        return 1.5 * self.phase_resistance_ohm / self.torque_constant_nm_a**2

    @cached_property
    def peak_impulse_nm_s(self) -> float:
        """The impulse by which the peak exceeds the rating, in all."""
        return PEAK_S * (self.peak_nm - self.rated_nm)

    @cached_property
    def least_useful_nm(self) -> float:
        """A torque that still overcomes the friction of standing jaws, in tenths of N·m."""
        return math.ceil(14.0 * self.breakaway_nm) / 10.0

    @cached_property
    def inertia_kg_m2(self) -> float:
        """The inertia of rotor and fingers."""
        return round(self.rotor_inertia_kg_m2 + FINGERS_KG_M2, 5)

    @cached_property
    def largest_acceleration_rad_s2(self) -> float:
        """The acceleration by a frame's largest torque, plus a tenth in reserve."""
        largest = 1.1 * self.ranges.torque_nm / self.inertia_kg_m2
        return math.ceil(largest / 1000.0) * 1000.0

    @cached_property
    def most_force_n(self) -> float:
        """The largest force that may be asked for, at 10 N for 1 N·m."""
        return min(MOST_FORCE_N, self.holding_nm * FORCE_PER_TORQUE_N_NM)

    @cached_property
    def fastest_rad_s(self) -> float:
        """The highest speed of any motion at the motor: the rated one, up to the gripper's."""
        return min(FASTEST_RAD_S, self.rated_speed_rad_s)


DM4310 = MotorType(
    name="DM4310",
    is_untried=False,
    ranges=Ranges(position_rad=12.5, velocity_rad_s=30.0, torque_nm=10.0),
    gear_ratio=10.0,
    rated_nm=3.0,
    holding_nm=4.0,  # the 40 N that the gripper's manual measured
    peak_nm=7.0,
    rated_speed_rad_s=12.57,
    no_load_speed_rad_s=20.9,
    rotor_inertia_kg_m2=1.8e-3,
    breakaway_nm=0.21,
    coulomb_nm=0.15,
    viscous_nm_s_rad=0.02,
    braking_nm_s_rad=0.7,
    torque_constant_nm_a=0.945,
    current_limit_a=10.26,
    phase_resistance_ohm=0.85,
    winding_k_w=2.8,
    winding_s=60.0,
    housing_k_w=1.5,
    housing_s=750.0,
)

DM4340 = MotorType(
    name="DM4340",
    is_untried=True,
    ranges=Ranges(position_rad=12.5, velocity_rad_s=10.0, torque_nm=28.0),
    gear_ratio=40.0,
    rated_nm=9.0,
    holding_nm=9.0,
    peak_nm=27.0,
    rated_speed_rad_s=3.77,
    no_load_speed_rad_s=5.5,
    rotor_inertia_kg_m2=2.88e-2,
    breakaway_nm=0.42,
    coulomb_nm=0.30,
    viscous_nm_s_rad=0.30,
    braking_nm_s_rad=11.2,
    torque_constant_nm_a=3.78,
    current_limit_a=10.26,
    phase_resistance_ohm=0.85,
    winding_k_w=2.8,
    winding_s=60.0,
    housing_k_w=1.5,
    housing_s=750.0,
)

FIGURES: Mapping[str, str] = MappingProxyType(
    {
        "ranges": "ranges of position, speed and torque",
        "gear_ratio": "gear ratio",
        "rated_nm": "rated torque",
        "holding_nm": "torque of a long hold",
        "peak_nm": "peak torque",
        "rated_speed_rad_s": "rated speed",
        "no_load_speed_rad_s": "no-load speed",
        "rotor_inertia_kg_m2": "rotor inertia",
        "breakaway_nm": "breakaway torque",
        "coulomb_nm": "Coulomb friction",
        "viscous_nm_s_rad": "viscous friction",
        "braking_nm_s_rad": "braking while disabled",
        "torque_constant_nm_a": "torque constant",
        "current_limit_a": "current limit",
        "phase_resistance_ohm": "phase resistance",
        "winding_k_w": "thermal resistance of the winding",
        "winding_s": "thermal time constant of the winding",
        "housing_k_w": "thermal resistance of the housing",
        "housing_s": "thermal time constant of the housing",
    }
)
"""What has to be known of a type before a motor of it can be driven, in words."""


@dataclass(frozen=True, slots=True)
class IncompleteType:
    """A type of the family of which not all figures are known: no motor of it can be driven.

    `figures` are the known ones, by their names in `MotorType`. With all of them it is a row.
    """

    name: str
    figures: Mapping[str, Ranges | float] = field(default_factory=dict)

    @property
    def known(self) -> tuple[str, ...]:
        """The known figures in words."""
        return tuple(words for figure, words in FIGURES.items() if figure in self.figures)

    @property
    def missing(self) -> tuple[str, ...]:
        """The missing figures in words."""
        return tuple(words for figure, words in FIGURES.items() if figure not in self.figures)


MOTOR_FAMILY: Mapping[str, MotorType | IncompleteType] = MappingProxyType(
    {
        row.name: row
        for row in (
            IncompleteType("DM3507"),
            DM4310,
            IncompleteType("DM4310_48V"),
            IncompleteType("DM4310P", {"ranges": Ranges(12.5, 50.0, 10.0)}),
            DM4340,
            IncompleteType("DM4340_48V"),
            IncompleteType("DM4340P", {"ranges": Ranges(12.5, 10.0, 28.0)}),
            IncompleteType("DM6006"),
            IncompleteType("DM6248P", {"ranges": Ranges(12.566, 20.0, 120.0)}),
            IncompleteType("DM8006"),
            IncompleteType("DM8009"),
            IncompleteType("DM10010L"),
            IncompleteType("DM10010"),
            IncompleteType("DMH3510"),
            IncompleteType("DMH6215"),
            IncompleteType("DMS3519"),
            IncompleteType("DMG6220"),
        )
    }
)
"""All types that the maker's drivers name (their enumeration, and DM4310P, DM4340P), with what is
known of them. The ranges that an incomplete type has are from there, too."""

NUMBERED_TYPES = tuple(name for name in MOTOR_FAMILY if name not in ("DM4310P", "DM4340P"))
"""The types by the numbers that the maker's drivers give them: 0 is a DM3507, 1 a DM4310."""

MOTOR_TYPES: Mapping[str, MotorType] = MappingProxyType(
    {name: row for name, row in MOTOR_FAMILY.items() if isinstance(row, MotorType)}
)
"""The types that can be driven, by the name that `[motor] type` has in the configuration."""


def why_not_driven(name: str) -> str | None:
    """Return why no motor of the type `name` can be driven, and what to do; None if one can."""
    row, driven = MOTOR_FAMILY.get(name), " or ".join(MOTOR_TYPES)
    if isinstance(row, MotorType):
        return None
    if row is None:
        others = ", ".join(one for one in MOTOR_FAMILY if one not in MOTOR_TYPES)
        return f"no type of the family; it must be {driven} (figures are missing of {others})"
    known = f", except for its {', '.join(row.known)}" if row.known else ""
    return (
        f"a type of the family that cannot be driven, for its figures are not known{known};"
        f" missing: {', '.join(row.missing)}; use a motor of type {driven}, or take the figures"
        " from the maker and give the type a row (docs/architecture.md)"
    )


@dataclass(frozen=True, slots=True)
class GripperId:
    """The gripper on one channel: its motor's CAN id and type, and its whole stroke in mm.

    `bus_channel` is the network interface or the adapter's file by which its bus is opened. `mount`
    is the template or the calibration file that the configuration names, None if it names none.
    """

    channel: str = "can0"
    bus_channel: str = "can0"
    can_id: int = 0x08
    stroke_mm: float = STROKE_MM
    mount: str | None = None
    motor_type: MotorType = DM4310
