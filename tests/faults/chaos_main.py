"""Runs chaos from a shell: `python -m tests.faults.chaos_main --help`; `make chaos` is a long run.

A seed that fails is printed with the command that runs it again; the others go on.
"""

import argparse
import os
import secrets
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed

from tests.faults.chaos import DefeatError, run

LONG_RUN_MINUTES = 30.0


def told(seed: int, minutes: float) -> tuple[bool, str]:
    """Run one seed; return whether all held, and what is to be told."""
    try:
        chaos = run(seed, minutes)
    except DefeatError as defeat:
        again = f"python -m tests.faults.chaos_main --seed {seed} --minutes {minutes:g}"
        return False, f"FAILED {defeat}\n  again: {again}"
    kept = f"{chaos.kept[0]} to {chaos.kept[-1]}" if chaos.kept else "uncounted"
    return True, (
        f"seed {seed}: {minutes:g} minutes, {chaos.episodes} episodes, {chaos.faults} faults,"
        f" kept objects {kept}, back to work within {chaos.slowest_s:.1f} s"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run one seed, or as many as make up so many simulated hours."""
    parser = argparse.ArgumentParser(description="Let chaos reign, in simulated time.")
    parser.add_argument("--seed", type=int, help="the first seed (default: any)")
    parser.add_argument("--minutes", type=float, help="simulated minutes of a seed")
    parser.add_argument("--hours", type=float, default=0.0, help="in all, by many seeds")
    options = parser.parse_args(arguments)
    minutes = options.minutes or (LONG_RUN_MINUTES if options.hours else 10.0)
    first = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    seeds = range(first, first + max(round(60.0 * options.hours / minutes), 1))
    if len(seeds) == 1:
        held, text = told(first, minutes)
        print(text)
        return 0 if held else 1
    return run_all(seeds, minutes)


def run_all(seeds: range, minutes: float) -> int:
    """Run many seeds on all cores; return the exit code."""
    failed = 0
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for done in as_completed([pool.submit(told, seed, minutes) for seed in seeds]):
            held, text = done.result()
            failed += not held
            print(text, flush=True)
    print(f"{len(seeds) - failed} of {len(seeds)} seeds held")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
