"""Whether a file's gains change what motions come to: `python -m tests.plants.gains`.

It writes docs/gains.md: for each pair of gains, on how many of some random grippers each motion came
out right. Takes about five minutes on two cores.
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

HEAD = """# What a file's gains do

<!-- Made by python -m tests.plants.gains from runs of the daemon; not to be edited. -->

A calibration file may have `kp` (1 to 500 N·m/rad) and `kd` (up to 5 N·m·s/rad, and at least
kp · 0.002 s). The file that ships has kp 5 and kd 2. With kp 5 the vendor's leads press with 0.07 N·m
on a stop, and friction alone takes 0.2. So the gains of a file do not decide whether a motion gets
there:

| what | stiffness and damping | pushes with at most |
| --- | --- | --- |
| `open`, `close` | 100 and 2 | on the way 5.3 N·m, with a softer file less, down to 2; at the stop 0.94 N·m |
| `move` | the call's kp (at least 55 is used) and kd, else 100 and 2 | the same |
| `grasp` | 100 and 2, softer the faster it closes | 1.05 N·m until it holds |
| `play` | the call's kp (at least 55 is used) and kd, else 100 and 2 | 2 N·m, or what is asked for |
| `zero`, `calibrate` | `calib_kp` and `calib_kd` | `calib_tau_limit`, 2 N·m |
| a follower | the call's kp and kd, else the file's, at least 55 | 5.3 N·m; at the stop 0.94 N·m |
| a stream of set-points | the call's kp and kd, else the file's, at least 55 | 1 N·m, or what is asked for |
| **a hold of a position**, after any motion | **the file's**, else 100 and 2 | what somebody pushes |

So a file's kp still says how stiff jaws hold where they are, and how hard `open`, `close` and `move`
push on what is in their way. With kp 5 a push of 1 N·m moves held jaws by 0.2 rad, 10 mm. A hold by
force (`grasp`, `set_force`) has no stiffness. A file whose kd is too small for its kp is refused: such
jaws swing by themselves.

`max_lead_mm` and `stop_lead_mm` of the motion configuration keep the vendor's names and values. Here
they mean torques, 1.34 N·m for each mm: what 1 mm of lead pushes with at the vendor's kp 100 and
74.8 mm/rad. Scale and gains of a file do not change them.

## Tried

Each cell: on how many of {plants} grippers the motion came out right (one as the simulator's, the
others random: friction, inertia, lags, play, noise). `open` goes to the work stroke of 80 mm and
onto the stop in turn, `move` runs at 20 and 150 mm/s, `teleop` follows a whole sweep, `play` repeats
what a hand has taught and a swing. "refused" is a file that is not taken. Jaws that stick with more
than the 0.94 N·m of a press are not asked to close, with any gains.

"""


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
    """Write the page; return 1 where a cell is not full."""
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
    PAGE.write_text(HEAD.format(plants=asked.plants) + "\n".join(lines) + "\n", encoding="utf-8")
    return 0 if is_full else 1


if __name__ == "__main__":
    sys.exit(main())
