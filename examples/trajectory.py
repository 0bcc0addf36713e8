"""Teach a motion by hand and repeat it.

python examples/trajectory.py --record 5 --save pick
python examples/trajectory.py --list
python examples/trajectory.py --play pick --repeat 3 [--speed 0.5] [--channel can0]
"""

import argparse
import sys
from collections.abc import Sequence

from litegrip_client import LiteGrip, LiteGripError, Trajectory, list_trajectories


def record(gripper: LiteGrip, seconds: float, name: str) -> None:
    """Let a hand push the slack jaws, and keep what it did."""
    print(f"The jaws are slack for {seconds:g} s: push them.", flush=True)
    taught = gripper.record(seconds)
    print(f"{len(taught)} samples in {taught.save(name)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example; return 0 when all went well."""
    parser = argparse.ArgumentParser(description="Teach a motion by hand and repeat it.")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--record", type=float, metavar="SECONDS")
    what.add_argument("--play", metavar="NAME")
    what.add_argument("--list", action="store_true", help="what was saved; needs no gripper")
    parser.add_argument("--save", metavar="NAME", default="taught")
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    options = parser.parse_args(arguments)
    if options.list:
        for path in list_trajectories():
            print(path)
        return 0
    taught = None if options.play is None else Trajectory.load(options.play)
    with LiteGrip(options.channel) as gripper:
        gripper.enable()
        if taught is None:
            record(gripper, options.record, options.save)
            return 0
        result = gripper.play(taught, speed=options.speed, repeat=options.repeat)
        print(f"ok={result.ok} ({result.outcome})")
        return 0 if result else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LiteGripError as error:
        hint = "; --list shows what was saved" if error.reason == "unknown_trajectory" else ""
        sys.exit(f"trajectory: {error}{hint}")
