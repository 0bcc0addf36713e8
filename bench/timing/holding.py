"""What a hold over an SLCAN adapter takes of a processor, and how soon its first frame comes.

python -m bench.timing.holding [SECONDS, default 10]

One daemon holds the simulated gripper, which is behind a pseudo-terminal, at real-time priority.
The time of a thread is the kernel's own account of it (`schedstat`). Needs to be root. Timings are
this machine's; what else runs changes them, as it takes the caches.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from tests.process.daemon_process import SLCAN, daemon
from tests.process.test_hardware import pump_of
from tests.sim.simulator_process import simulator

SIMULATOR_PRIORITY = 49


def processor_s(pid: int) -> float:
    """Return how long a process has run on a processor."""
    accounts = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(one.read_text(encoding="ascii").split()[0]) for one in accounts) / 1e9


def main() -> None:
    """Print the figures."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    with tempfile.TemporaryDirectory() as name, simulator("--pty") as peer:
        os.sched_setscheduler(peer.pid, os.SCHED_FIFO, os.sched_param(SIMULATOR_PRIORITY))
        folder = Path(name)
        config = folder / "litegripd.toml"
        config.write_text(SLCAN.format(channel=peer.first_line), encoding="utf-8")
        began_s = time.monotonic()
        with (
            daemon(folder, "can0", "--config", str(config)) as running,
            running.connect() as client,
        ):
            client.until(lambda state: state["position_rad"] is not None)
            first_s = time.monotonic() - began_s
            client.enabled()
            client.result("motion.hold")
            pids = running.process.pid, pump_of(running.process.pid)
            before_s = [processor_s(pid) for pid in pids]
            time.sleep(seconds)
            daemon_share, pump_share = (
                (processor_s(pid) - earlier_s) / seconds
                for pid, earlier_s in zip(pids, before_s, strict=True)
            )
            control = client.result("health")["control"]
            state = client.result("state.get")
    if state["mode"] != "holding":
        sys.exit(f"the jaws do not hold any more ({state['mode']}): this tells nothing")
    print(
        f"holding: daemon {daemon_share:.1%}, pump {pump_share:.1%} of a processor;"
        f" a tick takes {control['tick_cost']['p50_us']:.0f} µs,"
        f" p99 {control['tick_cost']['p99_us']:.0f} µs;"
        f" first frame {first_s:.2f} s after the start"
    )


if __name__ == "__main__":
    main()
