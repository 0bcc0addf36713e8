"""Whether a file's gains change what motions come to: `python -m tests.plants.gains`.

It writes the tables of docs/generated/gains-figures.md: for each pair of gains, on how many of some
random grippers each motion came out right; and the same on many for the file that ships, beside a
file that has no gains. It takes ten minutes on two cores.
"""

import argparse
import multiprocessing
import random
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from bench.pages import with_tables
from bench.tables import line
from tests.plants.files import SHIPPED_KD, SHIPPED_KP, SHIPPED_WORK_MM, STEPS, play_all
from tests.plants.parameters import PlantParameters, random_plant

PAGE = Path(__file__).resolve().parents[2] / "docs" / "generated" / "gains-figures.md"
KPS = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
KDS = (0.0, 0.05, 0.5, 1.0, 2.0, 5.0)
MOUNTS = ("normal", "reverse")


class Task(NamedTuple):
    """One gripper, the usual one for seed 0, with one file."""

    seed: int
    kp: float | None
    kd: float | None
    work_stroke_mm: float


FILES = {
    "the file that ships": (SHIPPED_KP, SHIPPED_KD, SHIPPED_WORK_MM),
    "one without gains": (None, None, 0.0),
}


def play(task: Task) -> list[list[str]]:
    """Return for each step what went wrong, in words."""
    mount = random.Random(f"gains {task.seed}").choice(MOUNTS)
    parameters = PlantParameters() if task.seed == 0 else random_plant(task.seed)
    return [play_all(parameters, mount, *task[1:], {name: step}) for name, step in STEPS.items()]


def counted(runs: list[list[list[str]]]) -> list[str]:
    """Return a cell for each step: on how many grippers nothing went wrong."""
    return [f"{sum(not run[step] for run in runs)}/{len(runs)}" for step, _name in enumerate(STEPS)]


def table(head: Iterable[str], rows: Iterable[list[str]]) -> str:
    """Return a table as the page has it."""
    names = [*head, *STEPS]
    lines = [names, ["---:"] * len(names), *rows]
    return "".join(f"{line(row)}\n" for row in lines)


def main() -> int:
    """Write the page's tables; name what went wrong, and return 1 where anything did."""
    parser = argparse.ArgumentParser(prog="python -m tests.plants.gains")
    parser.add_argument("plants", nargs="?", type=int, default=9, help="for each pair of gains")
    parser.add_argument("--files", type=int, default=200, metavar="PLANTS", help="for each file")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    asked = parser.parse_args()
    pairs = [(kp, kd) for kp in KPS for kd in KDS]
    by_gains = {
        pair: [
            Task(seed, *pair, SHIPPED_WORK_MM if seed % 2 else 0.0) for seed in range(asked.plants)
        ]
        for pair in pairs
    }
    by_file = {
        name: [Task(seed, *values) for seed in range(1, asked.files + 1)]
        for name, values in FILES.items()
    }
    tasks = [task for some in (*by_gains.values(), *by_file.values()) for task in some]
    with multiprocessing.Pool(asked.jobs) as pool:
        runs = dict(zip(tasks, pool.map(play, tasks, chunksize=1), strict=True))
    wrong = [(task, text) for task, run in runs.items() for step in run for text in step]
    for task, text in wrong:
        print(f"seed {task.seed}, kp {task.kp}, kd {task.kd}: {text}")

    def cells(some: list[Task]) -> list[str]:
        return counted([runs[task] for task in some])

    text = table(["file"], ([name, *cells(some)] for name, some in by_file.items()))
    text += "\n" + table(
        ["kp", "kd"],
        ([f"{kp:g}", f"{kd:g}", *cells(by_gains[kp, kd])] for kp, kd in pairs),
    )
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), text), encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
