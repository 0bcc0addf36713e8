"""Two grippers on one machine: both open at once, then one holds while the other one works.

python examples/two_grippers.py [--left can0] [--right can1]

LEFT needs something to hold, else it ends with "left: no_object" and exit code 1: with a simulated
gripper `object_mm = 40.0` in `[bus]` of its configuration.
Each has its own bus, daemon and channel; the channel is all that tells them apart.
"""

import argparse
import asyncio
import sys
from collections.abc import Sequence

from litegrip_client import LiteGripError
from litegrip_client.aio import LiteGrip


async def work(left_channel: str, right_channel: str) -> int:
    """Use both; return 0 when all motions ended well."""
    async with LiteGrip(left_channel) as left, LiteGrip(right_channel) as right:
        await asyncio.gather(left.enable(), right.enable())
        opened = await asyncio.gather(left.open(speed_mm_s=100), right.open(speed_mm_s=100))
        print("open:", *(f"{result.state.opening_mm:.0f} mm" for result in opened))
        grasped = await left.grasp(force_n=10, hold_s=0.5)  # the daemon goes on holding
        print("left:", grasped.outcome)
        moved = await right.goto(40.0)
        print("right:", moved.outcome)
        held = await left.get_state()
        print("left still holds:", held.is_grasped)
        return 0 if all(opened) and grasped and moved and held.is_grasped else 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example for the channels of the command line."""
    parser = argparse.ArgumentParser(description="Let two grippers work at once.")
    parser.add_argument("--left", default="can0", metavar="CHANNEL", help="the one that holds")
    parser.add_argument("--right", default="can1", metavar="CHANNEL", help="the one that works")
    options = parser.parse_args(arguments)
    return asyncio.run(work(options.left, options.right))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LiteGripError as error:
        sys.exit(f"two_grippers: {error}")
