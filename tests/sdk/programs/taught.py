"""Record a motion, list the recorded ones, replay one."""

import argparse
import os
import sys

from litegrip import LiteGrip, LiteGripError, Trajectory, trajectory_dir


def main() -> int:
    parser = argparse.ArgumentParser()
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--record", type=float)
    what.add_argument("--play")
    what.add_argument("--list", action="store_true")
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--save", default="taught")
    parser.add_argument("--rate", type=float, default=100.0)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--repeat", type=int, default=1)
    given = parser.parse_args()
    if given.list:
        for name in sorted(os.listdir(trajectory_dir())):
            one = Trajectory.load(name)
            print(name, len(one), f"{one.duration:.2f} {one.sample_hz:.0f}", one.mount)
        return 0
    try:
        taught = Trajectory.load(given.play) if given.play else None
    except FileNotFoundError as error:
        print(f"no file {error.filename}")
        return 1
    gripper = LiteGrip(given.channel)
    gripper.load_calibration()
    try:
        gripper.connect()
        gripper.enable()
        if taught is None:
            taken = gripper.record(given.record, rate_hz=given.rate)
            print(len(taken), os.path.basename(taken.save(given.save)))
            return 0
        for _ in range(given.repeat):
            status = gripper.play(taught, speed=given.speed, kp=None, kd=None, align=True)
            print(status["frames"] > 0, f"{status['openness']:.3f}", status["completed"])
    except LiteGripError as error:
        print(error)
        return 1
    finally:
        gripper.play_stop()
        gripper.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
