"""A policy in a closed loop at 50 Hz: each observation makes an action, which the jaws follow.

python examples/policy.py [--channel can0] [--seconds 5]

The loop has no clock of its own: the daemon sends 50 states a second, and the newest one counts.
A target is valid for 0.2 s: when a policy hangs, the jaws hold. A crash disables the motor.
"""

import argparse
import math
import sys
from collections.abc import Sequence

from litegrip_client import LiteGrip, LiteGripError

HZ = 50
OBSERVATION = ["monotonic_s", "openness", "velocity_rad_s", "torque_nm"]


def policy(observation: dict[str, float], elapsed_s: float) -> float:
    """Return the wanted share of the travel: a slow wave, which what is felt holds back.

    Put your own in its place.
    """
    wanted = 0.5 + 0.3 * math.sin(elapsed_s)
    is_pressing = abs(observation["torque_nm"]) > 0.6
    return observation["openness"] if is_pressing else wanted


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example."""
    parser = argparse.ArgumentParser(description="Let a policy drive the jaws at 50 Hz.")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--seconds", type=float, default=5.0)
    options = parser.parse_args(arguments)
    with LiteGrip(options.channel) as gripper:
        gripper.enable()
        with (
            gripper.states(HZ, OBSERVATION) as observations,
            gripper.stream(speed_mm_s=80, torque_nm=1.0) as jaws,
        ):
            steps, began_s = 0, None
            for seen in observations:
                began_s = seen["monotonic_s"] if began_s is None else began_s
                elapsed_s = seen["monotonic_s"] - began_s
                if elapsed_s >= options.seconds:
                    break
                jaws.set_target(openness=policy(seen, elapsed_s))
                steps += 1
        print(f"{steps} steps; the jaws are {gripper.get_state().openness:.2f} open")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LiteGripError as error:
        sys.exit(f"policy: {error}")
