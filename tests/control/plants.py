"""Random grippers with much friction, for what is measured of their stops."""

import random
from dataclasses import dataclass

from litegripd.model.calibration import NOMINAL
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.world import Client, World

RATES_HZ = (100, 200, 1000)
SPRINGBACK_RAD = 0.0275


@dataclass(frozen=True, slots=True)
class Plant:
    """One gripper, and how it is met."""

    mount: str
    rate_hz: int
    calibrated: bool
    parameters: SimulatorParameters

    def world(self) -> tuple[World, Client]:
        """Return its daemon, enabled, and a client."""
        world = World(
            self.mount,
            calibrated=self.calibrated,
            parameters=self.parameters,
            period_s=1.0 / self.rate_hz,
        )
        return world, world.enabled()

    @property
    def contact_rad(self) -> tuple[float, float]:
        """Where the jaws meet the closed and the open stop, before either gives way."""
        p = self.parameters
        useful_nm = p.press_torque_nm - p.coulomb_nm
        closed_rad = p.closed_rad - p.close_sign * useful_nm / p.closed_stiffness_nm_rad
        open_rad = p.open_rad + p.close_sign * useful_nm / p.open_stiffness_nm_rad
        return closed_rad, open_rad


def random_plant(seed: int, most_friction_nm: float = 1.4) -> Plant:
    """Return a gripper with friction and close-side stick up to `most_friction_nm`.

    Half of them have little friction while they move and stick in front of the closed stop; the
    others have any friction.
    """
    r = random.Random(seed)
    mount = ("normal", "reverse")[seed % 2]
    closed_rad, open_rad = limits_of_mount(mount)
    coulomb_nm = r.uniform(0.05, 0.45 if seed % 4 < 2 else most_friction_nm)
    breakaway_nm = min(coulomb_nm * r.uniform(1.0, 1.5), most_friction_nm)
    parameters = SimulatorParameters(
        closed_rad=closed_rad,
        open_rad=open_rad,
        initial_opening_mm=r.uniform(0.04, 0.96) * NOMINAL[0].travel_mm,
        coulomb_nm=coulomb_nm,
        breakaway_nm=breakaway_nm,
        close_stick_nm=max(breakaway_nm, r.uniform(0.8, most_friction_nm)),
        close_stick_speed_rad_s=r.uniform(0.05, 0.12),
        close_stick_zone_rad=r.uniform(0.05, 0.2),
        closed_springback_press_nm=2.0 * coulomb_nm
        + SPRINGBACK_RAD * r.choice((25, 60, 250, 1000)),
        closed_springback_rad=SPRINGBACK_RAD,
        open_stiffness_nm_rad=r.choice((100.0, 250.0, 1000.0)),
        press_torque_nm=max(0.94, coulomb_nm + 0.1),
        viscous_nm_s_rad=r.uniform(0.0, 0.1),
        rotor_inertia_kg_m2=1.8e-3 * r.uniform(0.8, 1.25),
    )
    return Plant(mount, r.choice(RATES_HZ), r.random() < 0.5, parameters)
