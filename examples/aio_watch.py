"""Watch the gripper on asyncio: one task prints what it does, another what happens to it.

python examples/aio_watch.py [--channel can0]
"""

import argparse
import asyncio
import contextlib
import sys
from collections.abc import Sequence

from litegrip_client import LiteGripError
from litegrip_client.aio import LiteGrip


async def print_states(gripper: LiteGrip) -> None:
    """Print the state five times a second."""
    async for state in gripper.states(hz=5):
        opening_mm = "-" if state.opening_mm is None else f"{state.opening_mm:.1f}"
        stale = " STALE" if state.stale else ""
        print(f"state {opening_mm:>6} mm  {state.mode}{stale}", flush=True)


async def print_events(gripper: LiteGrip) -> None:
    """Print what happens, as it happens, after the last things that happened before."""
    async with gripper.events() as events:
        for event in events.recent:
            print(f"before {event.kind}: {event.message}", flush=True)
        async for event in events:
            print(f"event {event.kind}: {event.message}", flush=True)


async def main(arguments: Sequence[str] | None = None) -> None:
    """Print both until interrupted, or until the daemon ends."""
    parser = argparse.ArgumentParser(description="Show states and events until Ctrl-C.")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--socket", metavar="PATH", help="another socket than the channel's")
    options = parser.parse_args(arguments)
    async with LiteGrip(options.channel, socket_path=options.socket) as gripper:
        await asyncio.gather(print_states(gripper), print_events(gripper))


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        try:
            asyncio.run(main())
        except LiteGripError as error:
            sys.exit(f"aio_watch: {error}")
