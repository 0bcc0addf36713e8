"""The figures of one gripper, and how far they vary from gripper to gripper.

Nominal figures come from the maker's table, the manual and field reports; those of the cable, the
backlash and the firmware's lags are estimates, and so the ranges in `random_plant` are wide.
"""

import math
import random
from dataclasses import dataclass
from typing import Any

TRAVEL_RAD, MM_RAD = 1.651026, 52.69
LIMITS_RAD = {"normal": (0.0, -1.651026), "reverse": (-1.651026, 0.0)}
"""Closed and open limit of each mount, where the jaws are pressed with `PRESS_NM`."""
PRESS_NM = 0.94
COGS_RAD = 168 * 10 / math.tau
"""Of 28 magnets and 24 teeth the least common multiple, and the gear of 10. The 14 pole pairs are
from the motor's registers; the teeth are an estimate."""


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """Torques, angles and inertias count at the motor's output shaft, times in seconds.

    `coulomb_nm` and its multiple `breakaway_ratio` are the sum of rotor and fingers, of which the
    rotor has `rotor_share`. `torque_factor` is the true torque as a share of what the motor
    believes and reports. `cogging_nm` is the amplitude of a torque that it does not report: magnets
    and teeth pull `COGS_RAD` times in a radian. A reported torque strays by up to
    `torque_noise_nm`. `delay_s` is that of a command and its answer together, and each way takes up
    to `jitter_s` more.
    """

    seed: int = 0
    rotor_kg_m2: float = 1.8e-3
    finger_kg_m2: float = 4.9e-5
    cable_nm_rad: float = 1500.0
    cable_damping_ratio: float = 0.15
    backlash_mm: float = 0.0
    coulomb_nm: float = 0.15
    breakaway_ratio: float = 1.4
    rotor_share: float = 0.6
    stribeck_rad_s: float = 0.05
    viscous_nm_s_rad: float = 0.02
    stick_nm: float = 0.95
    stick_rad_s: float = 0.08
    stick_zone_rad: float = 0.1
    closed_nm_rad: float = 25.5
    open_nm_rad: float = 250.0
    current_lag_s: float = 1e-3
    speed_lag_s: float = 1e-3
    report_lag_s: float = 4.5e-3
    speed_noise_rad_s: float = 0.0
    torque_noise_nm: float = 0.0
    torque_factor: float = 1.0
    cogging_nm: float = 0.0
    torque_limit_nm: float = 9.7
    no_load_rad_s: float = 20.9
    delay_s: float = 0.0
    jitter_s: float = 0.0
    timeout_s: float = 0.1
    gear: float = 10.0
    ranges: tuple[float, float, float] = (12.5, 30.0, 10.0)
    """Of position, velocity and torque, as the motor's frames have them."""

    @property
    def breakaway_nm(self) -> float:
        """What it takes to move standing jaws, outside the close-side stick zone."""
        return self.coulomb_nm * self.breakaway_ratio


def dm4340(**others: Any) -> PlantParameters:
    """Return a gripper whose motor is a DM4340: rotor and winding of a DM4310 behind a gear of 40.

    The maker's ranges and speed; the friction is an estimate.
    """
    figures: dict[str, Any] = {"coulomb_nm": 0.3, "viscous_nm_s_rad": 0.3, "rotor_share": 0.8}
    return PlantParameters(
        rotor_kg_m2=1.8e-5 * 40.0**2,
        torque_limit_nm=28.0,
        no_load_rad_s=5.5,
        gear=40.0,
        ranges=(12.5, 10.0, 28.0),
        **(figures | others),
    )


@dataclass(frozen=True, slots=True)
class Item:
    """An object: the jaws touch it at `width_mm`; it yields to more than `yield_nm`."""

    width_mm: float
    stiffness_nm_rad: float = 250.0
    damping_nm_s_rad: float = 0.4
    friction_nm: float = 0.0
    yield_mm_s: float = 0.0
    yield_nm: float = 0.0


def random_plant(seed: int) -> PlantParameters:
    """Return the gripper of this seed."""
    chance = random.Random(f"plant {seed}")
    uniform = chance.uniform
    return PlantParameters(
        seed=seed,
        rotor_kg_m2=1.8e-3 * uniform(0.5, 1.5),
        finger_kg_m2=4.9e-5 * uniform(1.0, 5.6),
        cable_nm_rad=between(chance, 150.0, 3000.0),
        cable_damping_ratio=uniform(0.03, 0.3),
        backlash_mm=chance.choice((0.0, uniform(0.0, 1.0), uniform(0.0, 1.0))),
        coulomb_nm=uniform(0.05, 0.45),
        breakaway_ratio=uniform(1.2, 2.0),
        rotor_share=uniform(0.4, 0.8),
        stribeck_rad_s=uniform(0.02, 0.2),
        viscous_nm_s_rad=uniform(0.005, 0.04),
        stick_nm=uniform(0.3, 1.4),
        stick_rad_s=uniform(0.04, 0.15),
        closed_nm_rad=uniform(18.0, 40.0),
        open_nm_rad=uniform(150.0, 350.0),
        current_lag_s=uniform(0.5e-3, 1.5e-3),
        speed_lag_s=uniform(0.0, 2e-3),
        report_lag_s=uniform(3e-3, 6e-3),
        speed_noise_rad_s=chance.choice((0.0, 0.0, uniform(0.05, 0.3))),
        torque_factor=uniform(0.8, 1.2),
        delay_s=uniform(0.0, 2e-3),
        jitter_s=uniform(0.0, 0.5e-3),
        timeout_s=chance.choice((0.1, 0.1, 0.4)),
    )


def between(chance: random.Random, low: float, high: float) -> float:
    """Return a random figure whose logarithm is evenly spread."""
    return math.exp(chance.uniform(math.log(low), math.log(high)))
