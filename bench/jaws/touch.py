"""The first touch, and loads that are no object: tables of docs/generated/grasping-figures.md.

python -m bench.jaws.touch

A figure is the worst of both mounts. The time is simulated, so the tables are the same on every
machine.
"""

import math
import random
import statistics
from dataclasses import replace
from itertools import product

from bench.jaws.rig import Rig, ours
from bench.tables import table
from litegripd.control.motions.grasp import GraspRequest
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.model.state import GraspResult
from litegripd.sim.plant import MOUNTS, SimulatorParameters
from tests.plants.parameters import Item, random_plant
from tests.plants.world import PlantWorld

USUAL = SimulatorParameters()
FORCES_N = (1.0, 2.0, 5.0, 10.0, 20.0, 40.0)
STIFFNESSES_NM_RAD = (100.0, 250.0, 1500.0)
MUCH_FRICTION = 3.0
WIDTH_MM, NEAR_MM = 45.0, 10.0
LOOKS = 20
BARELY_DAMPED = 0.05
"""What an object damps adds to what it feels: its damping times the speed, at once."""
SPEEDS_MM_S = (10.0, 25.0, 50.0, 100.0, FASTEST_MM_S)
LOADED_SPEEDS_MM_S = (25.0, 50.0, FASTEST_MM_S)
SEEDS, WEIGHT_NM = range(1, 61), 0.5
LOAD_STEP_NM, LARGEST_LOAD_NM = 0.05, 1.6


def rubbing(friction_nm: float, breakaway: float = 1.4) -> SimulatorParameters:
    """Return a gripper with this friction, and as stiff ends as usual."""
    breakaway_nm = breakaway * friction_nm
    return replace(
        USUAL,
        coulomb_nm=friction_nm,
        breakaway_nm=breakaway_nm,
        close_stick_nm=max(USUAL.close_stick_nm, breakaway_nm),
        closed_springback_press_nm=2.0 * friction_nm + 0.7,
        press_torque_nm=max(USUAL.press_torque_nm, friction_nm + 0.1),
    )


class TouchRig(Rig):
    """Notes the most that the object feels, as `felt_nm`."""

    felt_nm = 0.0

    def look(self, at_s: float) -> None:
        super().look(at_s)
        self.felt_nm = max(self.felt_nm, self.gripper.clamp_nm)

    def grasp(self, force_n: float, speed_mm_s: float) -> GraspResult:
        """Grasp to the verdict."""
        job = self.begin(ours(self.geometry, GraspRequest(force_n, speed_mm_s, until="verdict")))
        self.run_until(lambda: not job.is_running, 60.0)
        assert isinstance(job.result, GraspResult), job
        return job.result


def touched(
    force_n: float, stiffness_nm_rad: float, parameters: SimulatorParameters
) -> tuple[float, float]:
    """Return what an object feels up to the verdict, and how fast the jaws close, in N and mm/s."""
    felt_n = speed_mm_s = 0.0
    for mount in MOUNTS:
        rig = TouchRig(mount, WIDTH_MM + NEAR_MM, parameters=parameters)
        rig.looks = LOOKS
        rig.gripper.put_object(
            width_mm=WIDTH_MM, stiffness_nm_rad=stiffness_nm_rad, damping_nm_s_rad=BARELY_DAMPED
        )
        result = rig.grasp(force_n, FASTEST_MM_S)
        assert result.outcome == "object_held", result
        felt_n = max(felt_n, rig.felt_nm * rig.geometry.nm_to_n)
        speed_mm_s = result.speed_mm_s or 0.0
    return felt_n, speed_mm_s


def impact_n(speed_mm_s: float, stiffness_nm_rad: float) -> float:
    """Return what rotor and fingers at a speed do to a spring: speed·√(inertia·stiffness)."""
    speed_rad_s = speed_mm_s / USUAL.rad_to_mm
    return 10.0 * speed_rad_s * math.sqrt(USUAL.inertia_kg_m2 * stiffness_nm_rad)


def touch_row(force_n: float) -> list[str]:
    """Return what is felt of a force, by the stiffness of the object, and with much friction."""
    cells = []
    for stiffness_nm_rad in STIFFNESSES_NM_RAD:
        felt_n, speed_mm_s = touched(force_n, stiffness_nm_rad, USUAL)
        by_impact_n = impact_n(speed_mm_s, stiffness_nm_rad)
        cells.append(f"{felt_n:.1f} N ({by_impact_n:.1f})")
    much_n, speed_mm_s = touched(force_n, 250.0, rubbing(MUCH_FRICTION * USUAL.coulomb_nm))
    return [f"{force_n:g} N", f"{speed_mm_s:.0f} mm/s", *cells, f"{much_n:.1f} N"]


def impact_row(speed_mm_s: float) -> list[str]:
    """Return the impact at a speed, by the stiffness of the object."""
    return [
        f"{speed_mm_s:g} mm/s",
        *(f"{impact_n(speed_mm_s, stiffness):.1f} N" for stiffness in STIFFNESSES_NM_RAD),
    ]


def is_held(force_n: float, parameters: SimulatorParameters, weight_nm: float) -> bool:
    """Grasp nothing, at all speeds; return whether something counts as held."""
    for mount, speed_mm_s in product(MOUNTS, LOADED_SPEEDS_MM_S):
        rig = TouchRig(mount, 60.0, parameters=parameters)
        rig.gripper.push(-weight_nm * rig.geometry.close_sign)
        if rig.grasp(force_n, speed_mm_s).outcome == "object_held":
            return True
    return False


def borne_row(force_n: float) -> list[str]:
    """Return up to which load an empty grasp is never told as an object."""
    cells = [f"{force_n:g} N"]
    for rubs in (True, False):
        load_nm = LOAD_STEP_NM * 4
        while load_nm <= LARGEST_LOAD_NM:
            parameters = rubbing(load_nm, 1.0) if rubs else USUAL
            if is_held(force_n, parameters, 0.0 if rubs else load_nm):
                break
            load_nm += LOAD_STEP_NM
        cells.append(f"{load_nm - LOAD_STEP_NM:.2f} N·m")
    return cells


def grasped(seed: int, force_n: float, item: Item | None, weight_nm: float) -> tuple[str, float]:
    """Grasp with the random gripper of a seed; return the outcome, and the newtons felt."""
    chance = random.Random(f"touch {seed}")
    mount, rate_hz = chance.choice(MOUNTS), chance.choice((100, 200, 1000))
    speed_mm_s = chance.uniform(25.0, FASTEST_MM_S)
    world = PlantWorld(random_plant(seed), mount, rate_hz, opening_mm=WIDTH_MM)
    client = world.enabled()
    world.mechanics.put(item)
    world.mechanics.hand_nm = -weight_nm
    number = client.send("motion.grasp", force_n=force_n, speed_mm_s=speed_mm_s, until="verdict")
    world.run_until(lambda: client.has_answer(number), 60.0)
    outcome = str(client.answers[number]["result"]["outcome"])
    return outcome, max(look.clamp_n for look in world.looks)


def random_row(force_n: float) -> list[str]:
    """Return what random grippers do with an object, and with nothing, also under a weight."""
    item = Item(WIDTH_MM - NEAR_MM, 250.0, damping_nm_s_rad=BARELY_DAMPED)
    held = [grasped(seed, force_n, item, 0.0) for seed in SEEDS]
    cells = [f"{force_n:g} N", str(sum(outcome == "object_held" for outcome, _ in held))]
    felt_n = [newtons for _, newtons in held]
    cells += [f"{statistics.median(felt_n):.1f} N", f"{max(felt_n):.1f} N"]
    for weight_nm in (0.0, WEIGHT_NM):
        outcomes = [grasped(seed, force_n, None, weight_nm)[0] for seed in SEEDS]
        told = (f"{outcomes.count(name)} {name}" for name in sorted(set(outcomes)))
        cells.append(", ".join(told))
    return cells


def main() -> None:
    """Print all tables."""
    stiff = [f"{stiffness:g} N·m/rad" for stiffness in STIFFNESSES_NM_RAD]
    head = ["set", "closes at", *stiff, "250, three times the friction"]
    table("The first touch", head, map(touch_row, FORCES_N))
    table("The impact alone", ["speed", *stiff], map(impact_row, SPEEDS_MM_S))
    head = ["set", "held of 60", "felt, median", "most", "of 60 empty", "the same under 0.5 N·m"]
    table("Random grippers", head, map(random_row, (1.0, 5.0, 20.0)))
    head = ["set", "steady resistance", "weight that opens"]
    table("Loads that are no object", head, map(borne_row, (1.0, 5.0, 20.0)))


if __name__ == "__main__":
    main()
