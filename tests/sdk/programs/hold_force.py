"""Hold an object with a force, and judge by a sample a slice whether it sags."""

import argparse
import csv
import sys

from litegrip import LiteGrip, MoveProgress, UnitConversion


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--force", type=float, default=20.0)
    parser.add_argument("--hold-s", type=float, default=8.0)
    parser.add_argument("--sag-ratio", type=float, default=0.6)
    parser.add_argument("--hold-interval", type=float, default=0.2)
    parser.add_argument("--csv")
    given = parser.parse_args()
    rows: list[tuple[float, float]] = []
    with LiteGrip(given.channel) as gripper:
        gripper.load_calibration()
        gripper.actions.config.hold_interval = given.hold_interval
        gripper.enable()
        gripper.open()

        def watch(sample: MoveProgress) -> None:
            if sample.phase == "hold":
                force_n = abs(sample.torque_nm) * UnitConversion.NM_TO_N
                rows.append((sample.i * given.hold_interval, force_n))

        result = gripper.grasp(given.force, given.hold_s, progress=watch)
    if given.csv:
        with open(given.csv, "w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(rows)
    if len(rows) != result.cycles:
        print(f"{len(rows)} samples of {result.cycles} slices")
        return 1
    forces = [force_n for _, force_n in rows]
    second_half = forces[len(forces) // 2 :]
    mean = sum(second_half) / len(second_half)
    print(f"{rows[-1][0]:.1f} s, peak {max(forces):.1f} N, then {mean:.1f} N")
    held = result.ok and not (result.reached and not result.stalled)
    sags = max(forces) < given.force / 2.0 or mean < given.sag_ratio * given.force
    return 0 if held and not sags else 1


if __name__ == "__main__":
    sys.exit(main())
