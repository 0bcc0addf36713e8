"""Collect a data set while somebody teleoperates: each tick of the gripper becomes a line of CSV.

python examples/collect.py FILE [--channel can0] [--seconds 10]

It only watches, and needs no right to move. To try it with one gripper, have that follow a leader
that is no gripper: litegripctl enable && litegripctl teleop slave --fake-leader --detach
A file that exists stays as it is, and the example ends.
"""

import argparse
import csv
import sys
from collections.abc import Sequence

from litegrip_client import LiteGrip, LiteGripError

FIELDS = ["monotonic_s", "feedback_s", "openness", "velocity_rad_s", "torque_nm", "requested_rad"]
HZ = 200


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example; return 0 when no tick is missing in the file."""
    parser = argparse.ArgumentParser(description="Write what the gripper does to a file.")
    parser.add_argument("file")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args(arguments)
    rows, missing, last_s = 0, 0, None
    with (
        LiteGrip(options.channel) as gripper,
        open(options.file, "x", newline="", encoding="utf-8") as file,  # noqa: PTH123
        gripper.states(HZ, FIELDS, batch=50) as states,  # 50 at once cost the daemon the least
    ):
        out = csv.DictWriter(file, FIELDS)
        out.writeheader()
        for state in states:
            now_s = state["monotonic_s"]
            missing += 0 if last_s is None else round((now_s - last_s) * HZ) - 1
            last_s = now_s
            out.writerow(state)
            rows += 1
            if rows >= options.seconds * HZ:
                break
        follower = gripper.teleop_status()["phase"]
    print(f"{rows} rows, {missing} missing; the follower was {follower}")
    return 1 if missing else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (LiteGripError, OSError) as error:
        sys.exit(f"collect: {error}")
