"""The figures of the simulated gripper, with where each of them comes from.

One frozen value describes one gripper: its mechanics, its drive, its heat and its geometry. Nothing
here computes motion; `plant` and `motor` read these figures once, when they are built.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from litegripd.model.motor_types import DM4310, MotorType

MOUNTS = ("normal", "reverse")

SPEED_FILTER_MAX_HZ = 500.0
"""The largest value that register V_BW takes."""

ENCODER_COUNTS_PER_RAD = (1 << 14) * DM4310.gear_ratio / math.tau
"""About 26,000 steps per rad of the output: 14 bits a turn of the rotor and the gear of 10.

The 14 bits are from the maker's data sheet; that the rotor's encoder measures is an estimate.
"""


@dataclass(frozen=True, slots=True)
class SimulatorParameters:
    """All figures of one gripper; every torque and angle is at the motor's output shaft.

    `closed_rad` and `open_rad` are what a calibration would find: where the jaws are while they
    are pressed against that end with `press_torque_nm`. Their order is the mount: closing
    increases radians when `closed_rad` is the larger one.

    Raises `ValueError` for a figure that is not finite or out of its range.
    """

    # What the motor's registers say of its type. The figures below are a DM4310's as well; those
    # of another type are made by `of_motor`.
    motor_type: MotorType = DM4310

    # Identifiers (motor's manual: the factory setting of these grippers).
    can_id: int = 0x08
    master_id: int = 0x18

    # Time without a command after which the motor disarms (motors are known with 0.1 and 0.4 s).
    watchdog_s: float = 0.1

    # Geometry (calibration template of the normal mount).
    closed_rad: float = 0.114
    open_rad: float = -1.491
    rad_to_mm: float = 74.8
    initial_opening_mm: float = 60.0

    # Inertia (maker's table; gripper's model files: 2 x 35.45 g at about 31 mm/rad each).
    rotor_inertia_kg_m2: float = DM4310.rotor_inertia_kg_m2
    finger_inertia_kg_m2: float = 6.9e-5

    # Friction (motor's manual for the breakaway, estimates for the rest).
    breakaway_nm: float = DM4310.breakaway_nm
    coulomb_nm: float = DM4310.coulomb_nm
    viscous_nm_s_rad: float = DM4310.viscous_nm_s_rad

    # Close-side stick-slip (field measurements: a dead band of about 0.010 rad at the stock
    # stiffness of 100 N·m/rad). A little under 1 N·m, because the calibration's probe
    # (20 N·m/rad x 0.05 rad) is known to get through. It holds standing and slow jaws and leaves
    # travel at 50 mm/s (0.67 rad/s) nearly unhindered; speed and zone are estimates.
    close_stick_nm: float = 0.95
    close_stick_speed_rad_s: float = 0.08
    close_stick_zone_rad: float = 0.10

    # Ends (gripper's manual: the closed end springs back about 0.0275 rad after a press of 1 N·m;
    # field measurements: the open end has about 250 N·m/rad; damping is an estimate).
    press_torque_nm: float = 0.94
    closed_springback_rad: float = 0.0275
    closed_springback_press_nm: float = 1.0
    closed_damping_nm_s_rad: float = 0.13
    open_stiffness_nm_rad: float = 250.0
    open_damping_nm_s_rad: float = 0.4

    # Drive (maker's table; the braking of the shorted phases from field measurements).
    torque_constant_nm_a: float = DM4310.torque_constant_nm_a
    current_limit_a: float = DM4310.current_limit_a
    phase_resistance_ohm: float = DM4310.phase_resistance_ohm
    no_load_speed_rad_s: float = DM4310.no_load_speed_rad_s
    rated_supply_v: float = 24.0
    braking_nm_s_rad: float = DM4310.braking_nm_s_rad
    current_lag_s: float = 1.0e-3
    torque_filter_s: float = 4.5e-3

    # What the firmware measures. The speed filter is register 32, V_BW: 0 to 500. The maker names
    # no unit. It is taken as the corner of a first-order filter in Hz: field trials found a lag of
    # 1 to 2 ms, which is 160 to 80 Hz, while 500 rad/s would be 2 ms at least. 0 is taken as no
    # filter. The counts are at the output; 0 is an encoder without steps, `ENCODER_COUNTS_PER_RAD`
    # a likely one. The speed is the change of the counted position in a step of the simulation.
    speed_filter_hz: float = 100.0
    encoder_counts_per_rad: float = 0.0

    # Heat (estimates: 4.3 K/W in all, of which the housing, 750 s, holds the smaller part).
    ambient_c: float = 25.0
    winding_k_w: float = DM4310.winding_k_w
    winding_time_s: float = DM4310.winding_s
    housing_k_w: float = DM4310.housing_k_w
    housing_time_s: float = DM4310.housing_s
    driver_k_w: float = 0.4
    driver_time_s: float = 30.0
    driver_trip_c: float = 120.0  # firmware; the coil's limit is register 2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, MotorType):
                continue
            if not math.isfinite(value):
                raise ValueError(f"{field.name} must be a finite number, not {value!r}")
            if field.name not in _MAY_BE_ANY_SIGN and value < 0:
                raise ValueError(f"{field.name} must not be negative, but is {value!r}")
            if field.name in _MUST_BE_POSITIVE and value == 0:
                raise ValueError(f"{field.name} must be more than 0")
            most = _MOST.get(field.name, math.inf)
            if value > most:
                raise ValueError(f"{field.name} must be at most {most:g}, but is {value!r}")
        self._check_together()

    def _check_together(self) -> None:
        if self.closed_rad == self.open_rad:
            raise ValueError("closed_rad and open_rad are equal; the jaws would have no travel")
        if not 0 < self.can_id <= 0x7FE or not 0 <= self.master_id <= 0x7FE:
            raise ValueError(
                f"can_id must be 1 to 0x7FE and master_id 0 to 0x7FE, "
                f"but they are {self.can_id:#x} and {self.master_id:#x}"
            )
        if self.coulomb_nm > self.breakaway_nm or self.breakaway_nm > self.close_stick_nm:
            raise ValueError("friction must grow: coulomb_nm <= breakaway_nm <= close_stick_nm")
        if self.closed_springback_press_nm <= 2 * self.coulomb_nm:
            raise ValueError("closed_springback_press_nm must be more than twice coulomb_nm")
        if self.press_torque_nm <= self.coulomb_nm:
            raise ValueError("press_torque_nm must be more than coulomb_nm")

    def of_motor(self, motor_type: MotorType) -> SimulatorParameters:
        """Return the same gripper with a motor of this type; its ends stay as stiff as they are."""
        useful_nm = self.closed_springback_press_nm - 2 * motor_type.coulomb_nm
        return replace(
            self,
            motor_type=motor_type,
            rotor_inertia_kg_m2=motor_type.rotor_inertia_kg_m2,
            breakaway_nm=motor_type.breakaway_nm,
            coulomb_nm=motor_type.coulomb_nm,
            viscous_nm_s_rad=motor_type.viscous_nm_s_rad,
            closed_springback_rad=useful_nm / self.closed_stiffness_nm_rad,
            torque_constant_nm_a=motor_type.torque_constant_nm_a,
            current_limit_a=motor_type.current_limit_a,
            phase_resistance_ohm=motor_type.phase_resistance_ohm,
            no_load_speed_rad_s=motor_type.no_load_speed_rad_s,
            braking_nm_s_rad=motor_type.braking_nm_s_rad,
            winding_k_w=motor_type.winding_k_w,
            winding_time_s=motor_type.winding_s,
            housing_k_w=motor_type.housing_k_w,
            housing_time_s=motor_type.housing_s,
        )

    @property
    def close_sign(self) -> int:
        """+1 when closing increases radians (mount "normal"), -1 otherwise."""
        return 1 if self.closed_rad > self.open_rad else -1

    @property
    def inertia_kg_m2(self) -> float:
        """Rotor and fingers together, at the output."""
        return self.rotor_inertia_kg_m2 + self.finger_inertia_kg_m2

    @property
    def closed_stiffness_nm_rad(self) -> float:
        """Stiffness of the closed end that gives the measured spring-back.

        Friction costs twice: it keeps the press from going home by `coulomb_nm`, and it stops the
        way back while the end still pushes with `coulomb_nm`.
        """
        useful_nm = self.closed_springback_press_nm - 2 * self.coulomb_nm
        return useful_nm / self.closed_springback_rad

    @property
    def torque_limit_nm(self) -> float:
        """The most that the current limit allows, about 9.7 N·m."""
        return self.torque_constant_nm_a * self.current_limit_a


_MAY_BE_ANY_SIGN = frozenset({"closed_rad", "open_rad", "initial_opening_mm", "ambient_c"})
_MOST = {"speed_filter_hz": SPEED_FILTER_MAX_HZ}
_MUST_BE_POSITIVE = frozenset(
    {
        "rad_to_mm",
        "rotor_inertia_kg_m2",
        "close_stick_speed_rad_s",
        "closed_springback_rad",
        "open_stiffness_nm_rad",
        "torque_constant_nm_a",
        "current_limit_a",
        "phase_resistance_ohm",
        "no_load_speed_rad_s",
        "rated_supply_v",
        "torque_filter_s",
        "winding_time_s",
        "housing_time_s",
        "driver_time_s",
    }
)


def limits_of_mount(mount: str) -> tuple[float, float]:
    """Return the (closed, open) limits in rad of the calibration template of a mount.

    Raises `ValueError` for a mount other than "normal" and "reverse".
    """
    if mount not in MOUNTS:
        raise ValueError(f"mount must be one of {', '.join(MOUNTS)}, not {mount!r}")
    return (0.114, -1.491) if mount == "normal" else (-1.491, 0.114)
