"""The vendor SDK's way of pacing, for comparison: send a frame, then sleep for a period.

Runs alone, at ordinary priority, as a user's script does, on the simulated gripper. "Late" is
how much longer than a period each interval between two sends was. Prints its figures as JSON.
"""

import json
import sys
import time

import can

from litegripd.io.can.bus import to_message
from litegripd.io.meters import LatenessMeter
from litegripd.model.motor import CanFrame

PERIOD_S = 0.005
HOLD = to_message(CanFrame(0x08, bytes.fromhex("7FFF7FF0000007FF")))


def main() -> None:
    lateness = LatenessMeter()
    seconds = float(sys.argv[1])
    with can.Bus(interface="litegrip_sim", channel="pacing", ignore_config=True) as bus:
        began_s = previous_s = time.monotonic()
        frames = 0
        while previous_s - began_s < seconds:
            bus.send(HOLD)
            bus.recv(0)
            frames += 1
            time.sleep(PERIOD_S)
            now_s = time.monotonic()
            lateness.add(now_s - previous_s - PERIOD_S)
            previous_s = now_s
    lost = round((previous_s - began_s) / PERIOD_S) - frames
    print(json.dumps({"lateness": lateness.summary_us(), "lost_ticks": lost}))


if __name__ == "__main__":
    main()
