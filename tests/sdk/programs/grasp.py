"""Grasp nothing, then an object; print what each grasp said."""

import argparse
import sys

from litegrip import LiteGrip, LiteGripError, MoveProgress
from litegrip.actions import limit_target


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--force", type=float, default=20.0)
    parser.add_argument("--hold-s", type=float, default=2.0)
    parser.add_argument("--speed", type=float, default=40.0)
    parser.add_argument("--skip-empty", action="store_true")
    parser.add_argument("--skip-loaded", action="store_true")
    given = parser.parse_args()
    gripper = LiteGrip(given.channel)
    gripper.load_calibration()
    gripper.actions.config.grasp_speed_mm_s = given.speed
    gripper.config.kp = 100.0
    target, limit, offset, travel = limit_target(
        gripper.config, "close", gripper.actions.config.margin
    )
    print(f"target {target:+.4f} of {limit:+.4f}, {offset:.4f} of {travel:.4f}")
    try:
        gripper.connect()
        gripper.enable()
        cases = []
        if not given.skip_empty:
            cases.append(("empty", (True, False)))
        if not given.skip_loaded:
            cases.append(("loaded", (False, True)))
        slices: list[int] = []

        def watch(sample: MoveProgress) -> None:
            if sample.phase == "hold":
                slices.append(sample.i)

        for name, expected in cases:
            slices.clear()

            assert gripper.open(60.0, progress=watch)
            if name == "loaded":
                print("put it in", flush=True)
                input()
            result = gripper.grasp(given.force, given.hold_s, progress=watch)
            print(name, result.ok, result.reached, result.stalled, result.cycles, len(slices))
            print(gripper.is_grasped())
            if not result.ok or (result.reached, result.stalled) != expected:
                return 1
            if result.cycles <= 0 or slices != list(range(1, result.cycles + 1)):
                return 1
    except LiteGripError as error:
        print(error)
        return 1
    finally:
        gripper.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
