"""Enable, open and close with a progress bar: what a script for the gripper looks like.

python examples/open_close.py [--channel can0]
"""

import argparse
import sys
from collections.abc import Sequence

from litegrip_client import LiteGrip, LiteGripError, MoveProgress

BAR_WIDTH = 30


def show(progress: MoveProgress) -> None:
    """Draw the share of the motion that is done."""
    done = round(BAR_WIDTH * progress.i / progress.total_steps)
    bar = "#" * done + "." * (BAR_WIDTH - done)
    print(
        f"\r  {progress.phase:<7}[{bar}] cmd={progress.cmd_rad:+.3f} rad"
        f" pos={progress.pos_rad:+.3f} rad tau={progress.torque_nm:+.2f} Nm",
        end="",
        flush=True,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example; return 0 when both motions pressed home."""
    parser = argparse.ArgumentParser(description="Open and close once.")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--socket", metavar="PATH", help="another socket than the channel's")
    options = parser.parse_args(arguments)
    with LiteGrip(options.channel, socket_path=options.socket) as gripper:
        enabled = gripper.enable()
        print(f"enabled: {enabled.ok} after {enabled.tries} try")
        for motion in (gripper.open, gripper.close):
            print(f"{motion.__name__}:")
            result = motion(progress=show)
            print(f"\n  ok={result.ok} ({result.outcome}), {result.state.opening_mm:.1f} mm open")
            if not result:
                return 1
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LiteGripError as error:
        sys.exit(f"open_close: {error}")
