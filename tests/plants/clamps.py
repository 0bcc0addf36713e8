"""Whether what an object feels lies in the `clamp_n` that the state reports.

python -m tests.plants.clamps [N, default 300] [SEED, default 1] [--jobs 2]

Random grippers grasp random objects, on the other plant and on the simulator. At four moments of
each hold the truth is compared with the interval: once the force has settled, after a bump, after
the force was lowered, and in a search. The motor's torque constant is off by up to 5 or 20 %.
"""

import argparse
import multiprocessing
import random
import statistics
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from litegripd.model.motion_config import MotionConfig
from tests.plants.parameters import Item, PlantParameters, between, random_plant
from tests.plants.rigs import PlantRig, Rig, SimulatedRig
from tests.plants.trials import MOUNTS, RATES_HZ

KT_ERRORS = (0.05, 0.2)
MOMENTS = ("settled", "bumped", "lowered", "searching")
CLOSED_NM_RAD = 25.5
AFTER_S = 0.8
CONFIG = MotionConfig(force_rate_n_s=60.0)
WORST = 8
"""So many of the most wrong are named."""


@dataclass(frozen=True, slots=True)
class ClampTrial:
    """A gripper, an object, and what is done with them.

    `load_nm` closes the jaws all the time: a cable, a weight, a hand. `push_nm` is the bump's.
    """

    plant: PlantParameters
    item: Item
    mount: str
    rate_hz: int
    force_n: float
    lower_n: float
    speed_mm_s: float
    way_mm: float
    load_nm: float
    push_nm: float
    push_s: float
    step_mm: float


@dataclass(frozen=True, slots=True)
class Sample:
    """One moment: what is true, and between what the state says that it lies."""

    moment: str
    true_n: float
    low_n: float
    high_n: float

    @property
    def outside_n(self) -> float:
        """By how much the truth is outside; negative where it is inside."""
        return max(self.low_n - self.true_n, self.true_n - self.high_n)

    @property
    def is_inside(self) -> bool:
        """True if the interval is right."""
        return self.outside_n <= 0.0


def clamp_trial(seed: int, kt_error: float) -> ClampTrial:
    """Return the trial of a seed; another `kt_error` leaves the rest as it is."""
    chance = random.Random(f"clamp {seed}")
    uniform = chance.uniform
    plant = replace(
        random_plant(seed),
        torque_factor=1.0 + kt_error * uniform(-1.0, 1.0),
        cogging_nm=chance.choice((0.0, uniform(0.0, 0.06))),
        torque_noise_nm=uniform(0.0, 0.05),
    )
    item = Item(
        width_mm=uniform(14.0, 63.0),
        stiffness_nm_rad=between(chance, 60.0, 1500.0),
        damping_nm_s_rad=uniform(0.05, 1.0),
        friction_nm=chance.choice((0.0, 0.0, uniform(0.0, 0.2))),
    )
    force_n = uniform(2.0, 40.0)
    return ClampTrial(
        plant=plant,
        item=item,
        mount=chance.choice(MOUNTS),
        rate_hz=chance.choice(RATES_HZ),
        force_n=force_n,
        lower_n=max(force_n * uniform(0.3, 0.8), 2.0),
        speed_mm_s=uniform(25.0, 100.0),
        way_mm=uniform(2.0, 22.0),
        load_nm=chance.choice((0.0, 0.0, uniform(-0.15, 0.15))),
        push_nm=uniform(0.5, 4.0),
        push_s=uniform(0.01, 0.04),
        step_mm=uniform(0.8, 2.0),
    )


def plain_trial(plant: PlantParameters, force_n: float, load_nm: float = 0.0) -> ClampTrial:
    """Return a trial with a rigid object of 50 mm, 20 mm away, at the usual speed."""
    return ClampTrial(
        plant=plant,
        item=Item(50.0),
        mount="normal",
        rate_hz=200,
        force_n=force_n,
        lower_n=max(0.5 * force_n, 2.0),
        speed_mm_s=50.0,
        way_mm=20.0,
        load_nm=load_nm,
        push_nm=2.5,
        push_s=0.015,
        step_mm=1.0,
    )


def plant_rig(trial: ClampTrial) -> Rig:
    """Return the plant of this package."""
    opening_mm = trial.item.width_mm + trial.way_mm
    return PlantRig(trial.plant, trial.mount, trial.rate_hz, opening_mm, config=CONFIG)


def simulator_rig(trial: ClampTrial) -> Rig:
    """Return the simulator, its reports noisy, with the same figures as far as it has them."""
    plant = trial.plant
    return SimulatedRig(
        trial.mount,
        trial.rate_hz,
        trial.item.width_mm + trial.way_mm,
        is_looked_at=False,
        noise_seed=1,
        config=CONFIG,
        rotor_inertia_kg_m2=plant.rotor_kg_m2,
        finger_inertia_kg_m2=plant.finger_kg_m2,
        breakaway_nm=plant.breakaway_nm,
        coulomb_nm=plant.coulomb_nm,
        viscous_nm_s_rad=plant.viscous_nm_s_rad,
        close_stick_nm=max(plant.stick_nm, plant.breakaway_nm),
        close_stick_speed_rad_s=plant.stick_rad_s,
        closed_springback_rad=(1.0 - 2.0 * plant.coulomb_nm) / CLOSED_NM_RAD,
        current_lag_s=plant.current_lag_s,
        torque_filter_s=plant.report_lag_s,
        torque_factor=plant.torque_factor,
    )


KINDS: dict[str, Callable[[ClampTrial], Rig]] = {"plant": plant_rig, "simulator": simulator_rig}


def rig_of(name: str, trial: ClampTrial) -> Rig:
    """Return a gripper of one of `KINDS`, with the trial's object."""
    rig = KINDS[name](trial)
    rig.put(trial.item)
    return rig


def samples(name: str, trial: ClampTrial) -> list[Sample]:
    """Play a trial on one of `KINDS`; return its moments, as far as the object is held."""
    world = rig_of(name, trial)
    found: list[Sample] = []
    client = world.enabled()
    world.hand(trial.load_nm)

    def look(moment: str) -> list[Sample]:
        clamp_n = world.state.clamp_n
        return [] if clamp_n is None else [Sample(moment, world.true_n, *clamp_n)]

    client.call("motion.grasp", force_n=trial.force_n, speed_mm_s=trial.speed_mm_s, until="verdict")
    world.run(abs(trial.force_n - 10.0) / 60.0 + AFTER_S)
    found += look("settled")
    world.hand(trial.load_nm - trial.push_nm)
    world.run(trial.push_s)
    world.hand(trial.load_nm)
    world.run(AFTER_S)
    found += look("bumped")
    client.call("motion.set_force", force_n=trial.lower_n)
    world.run((trial.force_n - trial.lower_n) / 60.0 + AFTER_S)
    found += look("lowered")
    world.give_way(trial.step_mm)
    searching: list[Sample] = []
    for _ in range(round(0.3 / world.period_s)):
        world.tick()
        grip = world.controller.grip
        searching += look("searching") if grip is not None and grip.is_searching else []
    chance = random.Random(trial.plant.seed)
    return [*found, chance.choice(searching)] if searching else found


Task: TypeAlias = tuple[str, float, int]


def played(task: Task) -> list[Sample]:
    name, kt_error, seed = task
    return samples(name, clamp_trial(seed, kt_error))


def main() -> None:
    """Play, print the table, and name the worst."""
    parser = argparse.ArgumentParser(prog="python -m tests.plants.clamps")
    parser.add_argument("trials", nargs="?", type=int, default=300)
    parser.add_argument("first", nargs="?", type=int, default=1, metavar="SEED")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.trials)
    tasks = [(name, error, seed) for name in KINDS for error in KT_ERRORS for seed in seeds]
    with multiprocessing.Pool(asked.jobs) as pool:
        report(dict(zip(tasks, pool.map(played, tasks, chunksize=4), strict=True)))


def report(found: dict[Task, list[Sample]]) -> None:
    """Print the share of right intervals, how wide they are, and the most wrong ones."""
    print("| gripper | torque constant | " + " | ".join(MOMENTS) + " | all | half width |")
    print("| --- | --- |" + " ---: |" * (len(MOMENTS) + 2))
    for name in KINDS:
        for error in KT_ERRORS:
            ones = [
                one for task, some in found.items() if task[:2] == (name, error) for one in some
            ]
            parts = [[one for one in ones if one.moment == moment] for moment in MOMENTS]
            cells = " | ".join(share(part) for part in (*parts, ones))
            standing = [one for one in ones if one.moment != "searching"]
            width_n = statistics.median((one.high_n - one.low_n) / 2 for one in standing)
            print(f"| {name} | within {100 * error:.0f} % | {cells} | {width_n:.1f} N |")
    outside = [(one.outside_n, task, one) for task, some in found.items() for one in some]
    for by_n, (name, error, seed), one in sorted(outside, key=lambda row: -row[0])[:WORST]:
        print(
            f"{name}, {error:.0%}, seed {seed}, {one.moment}: {one.true_n:.1f} N in"
            f" {one.low_n:.1f} to {one.high_n:.1f} N, outside by {by_n:.1f} N"
        )


def share(ones: list[Sample]) -> str:
    """Return how many of them are right."""
    return f"{100 * sum(one.is_inside for one in ones) / max(len(ones), 1):.1f} %"


if __name__ == "__main__":
    main()
