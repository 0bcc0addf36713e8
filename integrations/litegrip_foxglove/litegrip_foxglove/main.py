"""`litegrip-foxglove`: grippers live in Foxglove.

It only reads: it takes no lease, moves nothing, and Foxglove can send it nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
from collections.abc import Sequence

import foxglove

from litegrip_client import LiteGripError
from litegrip_client.aio import LiteGrip
from litegrip_foxglove.watch import Watch


def main(arguments: Sequence[str] | None = None) -> None:
    """Show grippers until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(prog="litegrip-foxglove", description=__doc__)
    parser.add_argument(
        "channels", nargs="*", metavar="CHANNEL", help="default: LITEGRIP_CHANNEL, else can0"
    )
    parser.add_argument(
        "--hz", type=float, default=50.0, help="states a second, 0.1 to 200 (default: %(default)g)"
    )
    parser.add_argument("--host", default="127.0.0.1", help="default: %(default)s, this machine")
    parser.add_argument(
        "--port", type=int, default=8765, help="default: %(default)s; 0: a free one"
    )
    options = parser.parse_args(arguments)
    try:
        asyncio.run(_show(options))
    except (LiteGripError, RuntimeError) as error:
        sys.exit(f"litegrip-foxglove: {error}")


async def _show(options: argparse.Namespace) -> None:
    grippers = [LiteGrip(channel) for channel in options.channels or [None]]
    names = ", ".join(gripper.channel for gripper in grippers)
    context = foxglove.Context()
    server = foxglove.start_server(
        name=f"LiteGrip {names}", host=options.host, port=options.port, context=context
    )
    print(f"ws://{options.host}:{server.port} shows {names}", flush=True)
    tasks = [
        asyncio.ensure_future(Watch(gripper, options.hz, context, server).run())
        for gripper in grippers
    ]
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, lambda: [t.cancel() for t in tasks])
    try:
        await asyncio.gather(*tasks)
    except asyncio.CancelledError:
        await asyncio.gather(*tasks, return_exceptions=True)
    finally:
        server.stop()


if __name__ == "__main__":
    main()
