"""What a gripper is: its name on this machine, and the motors of its family."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from litegripd.model.geometry import FORCE_PER_TORQUE_N_NM, NOMINAL_RAD_TO_MM
from litegripd.model.motor import Ranges

PEAK_S = 0.5
"""How long the peak torque is allowed; less torque is allowed for longer."""

FINGERS_KG_M2 = 7e-5
"""Inertia of the gripper's fingers at the motor's output (from its model files)."""

FASTEST_MM_S = 500.0
"""The gripper's limit; a slow motor allows less."""


@dataclass(frozen=True)
class MotorType:
    """One type of motor. Torques, speeds and inertias are at the output, after the gear.

    `ranges` are those of a frame as the motor leaves the factory; the motor's own are used.
    `rated_nm` is allowed for long, `peak_nm` for `PEAK_S`. At `coil_limit_c` the daemon lowers the
    torque; it is well below the firmware's own limit. `braking_nm_s_rad` is that of a disabled
    motor.
    """

    name: str
    is_untried: bool
    ranges: Ranges
    gear_ratio: float
    rated_nm: float
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
    winding_k_w: float = 2.8
    winding_s: float = 60.0
    housing_k_w: float = 1.5
    housing_s: float = 750.0
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
        """The largest force that may be asked for, at the rated torque."""
        return self.rated_nm * FORCE_PER_TORQUE_N_NM

    @cached_property
    def fastest_mm_s(self) -> float:
        """The highest speed that may be asked for: the rated one, up to the gripper's limit."""
        return min(FASTEST_MM_S, math.floor(self.rated_speed_rad_s * NOMINAL_RAD_TO_MM))


DM4310 = MotorType(
    name="DM4310",
    is_untried=False,
    ranges=Ranges(position_rad=12.5, velocity_rad_s=30.0, torque_nm=10.0),
    gear_ratio=10.0,
    rated_nm=3.0,
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
)

DM4340 = MotorType(
    name="DM4340",
    is_untried=True,
    ranges=Ranges(position_rad=12.5, velocity_rad_s=10.0, torque_nm=28.0),
    gear_ratio=40.0,
    rated_nm=9.0,
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
)

MOTOR_TYPES: Mapping[str, MotorType] = MappingProxyType({row.name: row for row in (DM4310, DM4340)})
"""The types by the name that `[motor] type` has in the configuration."""


@dataclass(frozen=True, slots=True)
class GripperId:
    """The gripper on one channel: its motor's CAN id and type, and its whole stroke in mm.

    `bus_channel` is the network interface or the adapter's file by which its bus is opened. `mount`
    is the template or the calibration file that the configuration names, None if it names none.
    """

    channel: str = "can0"
    bus_channel: str = "can0"
    can_id: int = 0x08
    stroke_mm: float = 120.0
    mount: str | None = None
    motor_type: MotorType = DM4310
