"""Whether a file's gains change what motions come to: `python -m tests.plants.gains`.

It writes the table of docs/gains.md: for each pair of gains, on how many of some random grippers
each motion came out right. Takes about five minutes on two cores.
"""

import argparse
import multiprocessing
import random
import sys
from pathlib import Path

from litegripd.model.motion_config import damping_conflict
from tests.plants.files import SHIPPED_WORK_MM, STEPS, play_all
from tests.plants.parameters import PlantParameters, random_plant

PAGE = Path(__file__).resolve().parents[2] / "docs" / "gains.md"
KPS = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
KDS = (0.05, 0.5, 1.0, 2.0, 5.0)
MOUNTS = ("normal", "reverse")


def play(task: tuple[int, float, float]) -> dict[str, int]:
    """Return for each step 1 if nothing went wrong on the gripper of a seed (0: the usual one)."""
    seed, kp, kd = task
    chance = random.Random(f"gains {seed}")
    parameters = PlantParameters() if seed == 0 else random_plant(seed)
    mount, work_mm = chance.choice(MOUNTS), SHIPPED_WORK_MM if seed % 2 else 0.0
    return {
        name: int(not play_all(parameters, mount, kp, kd, work_mm, {name: step}))
        for name, step in STEPS.items()
    }


def main() -> int:
    """Write the page's table; return 1 where a cell is not full."""
    parser = argparse.ArgumentParser(prog="python -m tests.plants.gains")
    parser.add_argument("plants", nargs="?", type=int, default=9)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    pairs = [(kp, kd) for kp in KPS for kd in KDS]
    tried = [pair for pair in pairs if damping_conflict(*pair) is None]
    tasks = [(seed, *pair) for pair in tried for seed in range(asked.plants)]
    with multiprocessing.Pool(asked.jobs) as pool:
        runs = pool.map(play, tasks, chunksize=1)
    lines = [f"| kp | kd | {' | '.join(STEPS)} |", f"| ---: | ---: |{' ---: |' * len(STEPS)}"]
    is_full = True
    for kp, kd in pairs:
        if (kp, kd) not in tried:
            lines.append(f"| {kp:g} | {kd:g} | refused |{' |' * (len(STEPS) - 1)}")
            continue
        ones = [run for task, run in zip(tasks, runs, strict=True) if task[1:] == (kp, kd)]
        counts = {name: sum(run[name] for run in ones) for name in STEPS}
        is_full = is_full and all(count == asked.plants for count in counts.values())
        cells = " | ".join(f"{count}/{asked.plants}" for count in counts.values())
        lines.append(f"| {kp:g} | {kd:g} | {cells} |")
    above = PAGE.read_text(encoding="utf-8").partition(lines[0])[0]
    PAGE.write_text(above + "\n".join(lines) + "\n", encoding="utf-8")
    return 0 if is_full else 1


if __name__ == "__main__":
    sys.exit(main())
