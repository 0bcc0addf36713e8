"""A daemon on a simulated gripper whose jaws a hand moves: open and closed again, for ever.

python -m bench.teleop.handheld SECONDS_PER_SWEEP FROM_MM TO_MM DAEMON_ARGUMENTS...

The hand is a spring that is soft against the motor: jaws that hold do not follow it, slack ones do.
It is the one other thread of this process, which is no daemon of anybody's.
"""

import math
import sys
import threading
import time

from litegripd.app.main import main
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import gripper_on

_HAND_NM_MM = 0.06
_HAND_NM_S_MM = 0.0008
_MOST_NM = 0.9
_EVERY_S = 0.004


def move(gripper: SimulatedGripper, sweep_s: float, from_mm: float, to_mm: float) -> None:
    """Push the jaws towards a smooth sweep."""
    middle_mm, half_mm = (from_mm + to_mm) / 2.0, (to_mm - from_mm) / 2.0
    opening = -gripper.parameters.close_sign
    while True:
        turn = 2.0 * math.pi * time.monotonic() / sweep_s
        wanted_mm = middle_mm + half_mm * math.sin(turn)
        wanted_mm_s = half_mm * math.cos(turn) * 2.0 * math.pi / sweep_s
        speed_mm_s = opening * gripper.velocity_rad_s * gripper.parameters.rad_to_mm
        push_nm = _HAND_NM_MM * (wanted_mm - gripper.opening_mm)
        push_nm += _HAND_NM_S_MM * (wanted_mm_s - speed_mm_s)
        gripper.push(opening * min(max(push_nm, -_MOST_NM), _MOST_NM))
        time.sleep(_EVERY_S)


def wait_for_gripper(channel: str, sweep: tuple[float, float, float]) -> None:
    """Begin to move the gripper as soon as the daemon has put one on its bus.

    Opened by the hand, the channel would have a gripper of its own, and be closed to the daemon.
    """
    while (gripper := gripper_on(channel)) is None:
        time.sleep(0.05)
    move(gripper, *sweep)


if __name__ == "__main__":
    figures = tuple(map(float, sys.argv[1:4]))
    hand = threading.Thread(
        target=wait_for_gripper, args=(sys.argv[4], figures), daemon=True, name="hand"
    )
    hand.start()
    sys.exit(main(sys.argv[4:]))
