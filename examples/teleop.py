"""Run one end of a teleoperation: lead by hand, or follow.

python examples/teleop.py --mode master [--channel can0]
python examples/teleop.py --mode slave --host 192.168.1.20 [--torque-limit 1.0]
python examples/teleop.py --mode slave --fake-leader --torque-limit 1.0

Ctrl-C ends it; leaving the block then disables the motor.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from litegrip_client import LiteGrip, LiteGripError


def line(status: dict[str, Any]) -> str:
    """Show how it goes in one line; a link that has failed is told, with its reason."""
    openness, torque_nm = status["openness"], status["torque_nm"]
    shown = (
        f"{status['phase']:<9} link {status['link_state']}  frames {status['frames']:>6}"
        f"  openness {'-' if openness is None else f'{openness:.3f}'}"
        f"  torque {'-' if torque_nm is None else f'{torque_nm:+.2f}'} N·m"
        f"  {status['loop_hz']:.0f} Hz  stale {status['stale']}  trips {status['torque_trips']}"
    )
    return shown if status["link_error"] is None else f"{shown}  {status['link_error']}"


def follow_along(gripper: LiteGrip, seconds: float | None) -> None:
    """Print how it goes, five times a second, until it ends."""
    with gripper.states(5, ["monotonic_s"]) as ticks:
        began_s: float | None = None
        for tick in ticks:
            status = gripper.teleop_status()
            print(line(status), flush=True)
            began_s = tick["monotonic_s"] if began_s is None else began_s
            is_over = seconds is not None and tick["monotonic_s"] - began_s >= seconds
            if is_over or not status["active"]:
                return


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example."""
    parser = argparse.ArgumentParser(description="Run one end of a teleoperation.")
    parser.add_argument("--mode", choices=("master", "slave"), required=True)
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--host", help="the leader's machine")
    parser.add_argument("--link", choices=("zenoh", "udp"))
    parser.add_argument("--fake-leader", action="store_true")
    parser.add_argument("--torque-limit", type=float, metavar="NM")
    parser.add_argument("--seconds", type=float, metavar="S", help="end by itself after so long")
    options = parser.parse_args(arguments)
    with LiteGrip(options.channel) as gripper:
        gripper.enable()
        gripper.teleop_start(
            options.mode,
            host=options.host,
            link=options.link,
            fake_leader=options.fake_leader,
            torque_limit_nm=options.torque_limit,
        )
        try:
            follow_along(gripper, options.seconds)
        except KeyboardInterrupt:
            print()
        status = gripper.teleop_stop()
        print(f"ended after {status['frames']} frames; {status['fault'] or 'no fault'}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LiteGripError as error:
        sys.exit(f"teleop: {error}")
