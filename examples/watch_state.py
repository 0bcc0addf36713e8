"""Watch the gripper while somebody else moves it: a second process, reading only.

python examples/watch_state.py [--channel can0]
"""

import argparse
import contextlib
import sys
from collections.abc import Sequence

from litegrip_client import LiteGrip, LiteGripError

BAR_WIDTH = 40


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the state five times a second until interrupted or until the daemon ends."""
    parser = argparse.ArgumentParser(description="Show the state until Ctrl-C.")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--socket", metavar="PATH", help="another socket than the channel's")
    options = parser.parse_args(arguments)
    with LiteGrip(options.channel, socket_path=options.socket) as gripper:
        for state in gripper.states(hz=5):
            opening_mm = state.opening_mm or 0.0
            filled = round(BAR_WIDTH * (state.openness or 0.0))
            bar = "=" * filled + " " * (BAR_WIDTH - filled)
            job = state.job["kind"] if state.job else "-"
            stale = " STALE" if state.stale else ""
            print(f"[{bar}] {opening_mm:6.1f} mm  {state.mode:<9} {job:<6}{stale}", flush=True)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        try:
            main()
        except LiteGripError as error:
            sys.exit(f"watch_state: {error}")
