"""Many random plants through all scenes, as one table.

python -m tests.plants [N, default 300] [SEED, default 1] [--jobs 2] [--scenes bump,step]
python -m tests.plants --seed K plays one of them again and says what was seen.
"""

import argparse
import multiprocessing
import statistics
import sys
import time
from collections.abc import Callable

from tests.plants.scenes import SCENES, Seen, play


def played(task: tuple[str, int]) -> Seen:
    return play(*task)


def count(predicate: Callable[[Seen], object]) -> Callable[[list[Seen]], str]:
    return lambda runs: str(sum(bool(predicate(seen)) for seen in runs))


def figure(
    name: str, summary: Callable[[list[float]], float], form: str, factor: float = 1.0
) -> Callable[[list[Seen]], str]:
    """Return a column of a figure that not every run has."""

    def column(runs: list[Seen]) -> str:
        values = [factor * value for seen in runs if (value := getattr(seen, name)) is not None]
        return format(summary(values), form) if values else "-"

    return column


def worst_error_mm(runs: list[Seen]) -> str:
    errors = [abs(mm) for seen in runs if seen.errors_mm is not None for mm in seen.errors_mm]
    return f"{max(errors):.1f}" if errors else "-"


COLUMNS: dict[str, Callable[[list[Seen]], str]] = {
    "runs": count(lambda _: True),
    "right": count(lambda seen: seen.is_right),
    "wrong": count(lambda seen: seen.wrong),
    "dropped": count(lambda seen: seen.dropped),
    "called lost": count(lambda seen: seen.called_lost),
    "shaking": count(lambda seen: seen.shaking),
    "untold": count(lambda seen: seen.untold),
    "broken": count(lambda seen: seen.broken),
    "stuck": count(lambda seen: seen.stuck),
    "jaws mm/s": figure("peak_mm_s", max, ".0f"),
    "motor mm/s": figure("rotor_mm_s", max, ".0f"),
    "N·m": figure("peak_nm", max, ".1f"),
    "verdict ms": figure("verdict_s", max, ".0f", 1e3),
    "told p50": figure("told_s", statistics.median, ".0f", 1e3),
    "told max": figure("told_s", max, ".0f", 1e3),
    "zero mm": worst_error_mm,
}


def main() -> int:
    """Play, print, and return 1 where anything is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.plants")
    parser.add_argument("plants", nargs="?", type=int, default=300)
    parser.add_argument("first", nargs="?", type=int, default=1, metavar="SEED")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--scenes", default=",".join(SCENES), help="names, with commas between")
    parser.add_argument("--seed", type=int, help="play the plant of this seed alone, and tell all")
    asked = parser.parse_args()
    scenes = asked.scenes.split(",")
    seeds = range(asked.first, asked.first + asked.plants)
    if asked.seed is not None:
        seeds = range(asked.seed, asked.seed + 1)
    tasks = [(scene, seed) for scene in scenes for seed in seeds]
    began_s = time.perf_counter()
    if asked.jobs > 1:
        with multiprocessing.Pool(asked.jobs) as pool:
            runs = pool.map(played, tasks, chunksize=4)
    else:
        runs = [played(task) for task in tasks]
    report(runs, scenes, in_full=asked.seed is not None)
    print(f"{len(runs)} runs in {time.perf_counter() - began_s:.0f} s")
    return 0 if all(seen.is_right for seen in runs) else 1


def report(runs: list[Seen], scenes: list[str], *, in_full: bool) -> None:
    """Print the table, and below it what is wrong with which seed."""
    widths = {title: max(len(title), 4) + 2 for title in COLUMNS}
    print("scene   " + "".join(f"{title:>{width}}" for title, width in widths.items()))
    for scene in scenes:
        ones = [seen for seen in runs if seen.scene == scene]
        cells = (f"{column(ones):>{widths[title]}}" for title, column in COLUMNS.items())
        print(f"{scene:<8}" + "".join(cells))
    for seen in runs:
        if in_full:
            print(f"\n{seen}")
        elif not seen.is_right:
            trial = seen.trial
            print(
                f"{seen.scene} --seed {trial.plant.seed} ({trial.mount}, {trial.rate_hz} Hz,"
                f" {trial.force_n:.1f} N, {trial.speed_mm_s:.0f} mm/s): "
                + "; ".join(seen.complaints)
            )


if __name__ == "__main__":
    sys.exit(main())
