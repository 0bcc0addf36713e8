"""Which gains let a hold swing after a push or a pull: `python -m tests.plants.holds`.

It writes a table of docs/gains.md, of gains that the daemon's own bound of holds is kept away from.
The grippers are the random ones that bear least damping, and the first ones as they come.
"""

import argparse
import multiprocessing
import sys
from collections import Counter
from pathlib import Path

from litegripd.control.controller import Controller
from litegripd.control.holds import Hold
from litegripd.control.limiter import Gains, SwingGuard
from litegripd.model.motor import Feedback, MitCommand
from tests.plants.parameters import PlantParameters, random_plant
from tests.plants.watch import is_shaking
from tests.plants.world import PlantWorld

PAGE = Path(__file__).resolve().parents[2] / "docs" / "gains.md"
KPS = (5.0, 100.0, 200.0, 500.0)
KDS = (0.4, 0.6, 1.0, 2.0, 5.0)
RATES_HZ = (100, 200)
CHOSEN_OF, LEAST_DAMPED, AS_THEY_COME = 1000, 7, 3
PUSH_NM, PUSH_S = 3.0, 0.03
PULL_MM, PULL_S = 15.0, 0.15
RINGS_S, WINDOW_S = 0.9, 0.45

Task = tuple[int, int, float, float, bool]


class Unguarded(SwingGuard):
    """Neither bounds nor calms: a hold has the gains that it is given."""

    def bound(self, gains: Gains) -> Gains:
        return gains

    def calm(self, command: MitCommand, feedback: Feedback) -> tuple[MitCommand, bool]:
        return command, False


def unguard(controller: Controller) -> None:
    """Let holds have whatever gains they are given."""
    controller.swing = Unguarded()


def bears_nm_s_rad(plant: PlantParameters) -> float:
    """Return about how much damping a free rotor bears: J·(1/T_filter + 1/T_current)."""
    lags_s = (max(plant.speed_lag_s, 1e-4), plant.current_lag_s)
    return plant.rotor_kg_m2 / plant.torque_factor * sum(1.0 / lag_s for lag_s in lags_s)


def seeds() -> list[int]:
    """Return the grippers of the table."""
    by_damping = sorted(range(1, CHOSEN_OF + 1), key=lambda s: bears_nm_s_rad(random_plant(s)))
    return by_damping[:LEAST_DAMPED] + list(range(1, AS_THEY_COME + 1))


def swings(task: Task) -> bool:
    """Return whether a hold with these gains still swings half a second after it was disturbed."""
    seed, rate_hz, kp, kd, is_push = task
    world = PlantWorld(random_plant(seed), "normal", rate_hz, opening_mm=45.0)
    world.enabled()
    unguard(world.controller)
    world.run(0.05)
    feedback = world.measured
    world.controller.idle = Hold(feedback.position_rad, Gains(kp, kd))
    world.run(0.1)
    if is_push:
        world.push_open(PUSH_NM, PUSH_S)
        world.run(PUSH_S)
    else:
        world.hold_open(PULL_MM, PULL_S)
        world.run(PULL_S)
    world.run(RINGS_S)
    return is_shaking(world.looks_since(world.now_s - WINDOW_S))


def main() -> int:
    """Write the page's table."""
    parser = argparse.ArgumentParser(prog="python -m tests.plants.holds")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    tasks: list[Task] = [
        (seed, rate_hz, kp, kd, is_push)
        for kp in KPS
        for kd in KDS
        for seed in seeds()
        for rate_hz in RATES_HZ
        for is_push in (True, False)
    ]
    with multiprocessing.Pool(asked.jobs) as pool:
        runs = pool.map(swings, tasks, chunksize=4)
    counts: Counter[tuple[float, float]] = Counter()
    for task, is_swinging in zip(tasks, runs, strict=True):
        counts[task[2:4]] += is_swinging
    head = "| kp \\ kd | " + " | ".join(f"{kd:g}" for kd in KDS) + " |"
    lines = [head, "| ---: |" + " ---: |" * len(KDS)]
    lines += [f"| {kp:g} | " + " | ".join(str(counts[kp, d]) for d in KDS) + " |" for kp in KPS]
    text = PAGE.read_text(encoding="utf-8")
    above, _, rest = text.partition(head)
    below = rest.partition("\n\n")[2]
    PAGE.write_text(above + "\n".join(lines) + "\n\n" + below, encoding="utf-8")
    print(f"{len(tasks) // (len(KPS) * len(KDS))} holds a cell")
    return 0


if __name__ == "__main__":
    sys.exit(main())
