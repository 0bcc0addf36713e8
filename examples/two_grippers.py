"""Two grippers on one machine: both open at once, then one holds while the other one works.

python examples/two_grippers.py [LEFT RIGHT]

Each has its own bus, daemon and channel; the channel is all that tells them apart.
"""

import asyncio
import sys

from litegrip_client import LiteGripError
from litegrip_client.aio import LiteGrip


async def main(left_channel: str, right_channel: str) -> int:
    """Run the example; return 0 when all motions ended well."""
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


if __name__ == "__main__":
    try:
        sys.exit(asyncio.run(main(*(sys.argv[1:] or ("can0", "can1")))))
    except LiteGripError as error:
        sys.exit(f"two_grippers: {error}")
