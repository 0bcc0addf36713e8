"""Grasp something; when it is lost, open and grasp again, until it has been held for long enough.

python examples/hold_on.py [--channel can0] [--force 10] [--hold 3]
"""

import argparse
import sys
from collections.abc import Sequence

from litegrip_client import LiteGrip, LiteGripError, MoveProgress

BAR_WIDTH = 30
ATTEMPTS = 5


def show(progress: MoveProgress) -> None:
    """Draw the share of the way that is done; a hold has no end to be drawn."""
    total = progress.total_steps or progress.i or 1
    done = round(BAR_WIDTH * min(progress.i / total, 1.0))
    bar = "#" * done + "." * (BAR_WIDTH - done)
    print(f"\r  {progress.phase:<7}[{bar}] {progress.torque_nm:+.2f} N·m", end="", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example; return 0 when something was held for as long as asked."""
    parser = argparse.ArgumentParser(description="Grasp something, and hold on to it.")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--socket", metavar="PATH", help="another socket than the channel's")
    parser.add_argument("--force", type=float, default=10.0, metavar="N")
    parser.add_argument("--hold", type=float, default=3.0, metavar="S")
    options = parser.parse_args(arguments)
    with LiteGrip(options.channel, socket_path=options.socket) as gripper:
        gripper.enable()
        for _ in range(ATTEMPTS):
            print("open:")
            opened = gripper.open(progress=show)
            print(f"\n  {opened.outcome}, {opened.state.opening_mm:.1f} mm open")
            print(f"grasp with {options.force:g} N:")
            result = gripper.grasp(options.force, options.hold, progress=show)
            width = "" if result.width_mm is None else f", {result.width_mm:.1f} mm wide"
            print(f"\n  {result.outcome}{width}, held for {result.held_s:.1f} s")
            if result:
                return 0
    return 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LiteGripError as error:
        sys.exit(f"hold_on: {error}")
