"""The machine's own noise: a bare loop at the same rate and priority that does nothing at all.

Run beside a measurement, it tells which late ticks are the machine's (a virtual machine whose
host takes the processor away, a kernel section that cannot be preempted) and which are ours.

python -m bench.timing.reference SECONDS [PROCESSOR, default any]
"""

import json
import os
import sys
import time

from litegripd.io.loop import PeriodicTimer
from litegripd.io.meters import LatenessMeter
from litegripd.io.realtime import acquire

PERIOD_S = 0.005
PRIORITY = 51  # above the daemon's, so that only the machine can delay it


def main() -> None:
    """Wait for `seconds` of ticks and print their lateness as JSON."""
    if len(sys.argv) > 2:
        os.sched_setaffinity(0, {int(sys.argv[2])})
    acquire(PRIORITY, ())
    timer = PeriodicTimer(PERIOD_S)
    lateness = LatenessMeter()
    lost = 0
    for _ in range(round(float(sys.argv[1]) / PERIOD_S)):
        fired = timer.wait()
        lateness.add(time.monotonic() - timer.last_due_s)
        lost += fired - 1
    timer.close()
    print(json.dumps({**lateness.summary_us(), "lost": lost}))


if __name__ == "__main__":
    main()
