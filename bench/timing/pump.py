"""What a busy machine does to an SLCAN adapter: with its pump at real-time priority, and without.

python -m bench.timing.pump [SECONDS per row, default 20] [BUSY LOOPS, default 5]

One daemon drives the simulated gripper over a pseudo-terminal. It opens and closes the jaws all the
time, beside processes that never wait. The simulator runs at real-time priority in both rows: what
is measured is the pump. Needs to be root. Timings are this machine's.

The last column is what nothing here could have prevented: for how long a bare loop above all of
these was kept off its processor, the worst of one on each. A virtual machine's host does so.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.process.daemon_process import SLCAN, Client, daemon
from tests.process.test_hardware import pump_of
from tests.sim.simulator_process import simulator

SIMULATOR_PRIORITY = 49
BUSY = "while True: pass"


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep the processors busy by so many processes."""
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


@contextlib.contextmanager
def watched(seconds: float, worst_us: list[float]) -> Iterator[None]:
    """Note how late a bare loop was on each processor, at worst."""
    words = [sys.executable, "-m", "bench.timing.reference", str(seconds)]
    loops = [
        subprocess.Popen([*words, str(processor)], stdout=subprocess.PIPE)
        for processor in sorted(os.sched_getaffinity(0))
    ]
    yield
    worst_us += [float(json.loads(loop.communicate()[0])["worst_us"]) for loop in loops]


def be_ordinary(pid: int) -> None:
    """Let all threads of a process run as any other's."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))


def row(is_ordinary: bool, seconds: float, loops: int) -> list[str]:
    """Return the cells of one run."""
    machine_us: list[float] = []
    with tempfile.TemporaryDirectory() as folder, simulator("--pty") as peer:
        os.sched_setscheduler(peer.pid, os.SCHED_FIFO, os.sched_param(SIMULATOR_PRIORITY))
        config = Path(folder) / "litegripd.toml"
        config.write_text(SLCAN.format(channel=peer.first_line), encoding="utf-8")
        with (
            daemon(Path(folder), "can0", "--config", str(config)) as running,
            running.connect() as client,
        ):
            client.until_health(lambda health: bool(health["bus"]["state"] == "up"))
            client.enabled()
            if is_ordinary:
                be_ordinary(pump_of(running.process.pid))
            with watched(seconds, machine_us), busy(loops):
                done, failed = moved(client, seconds)
            health = client.result("health")
    bus = health["bus"]
    return [
        "ordinary" if is_ordinary else "real-time",
        str(done),
        str(failed),
        str(bus["send_failures"]),
        f"{bus['pump_late_us'] / 1e3:.1f} ms",
        f"{max(machine_us) / 1e3:.1f} ms",
    ]


def moved(client: Client, seconds: float) -> tuple[int, int]:
    """Open and close for some seconds; return how many motions there were, and how many failed."""
    ends_s, done, failed = time.monotonic() + seconds, 0, 0
    while time.monotonic() < ends_s:
        for target in (0.3, 0.7):
            answer: dict[str, Any] = client.call("motion.move", openness=target, speed_mm_s=100.0)
            done += 1
            if not answer.get("result", {}).get("ok"):
                failed += 1
                time.sleep(0.2)
                client.call("motor.enable")
    return done, failed


def main() -> None:
    """Print the table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    loops = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    print("| pump | motions | failed | frames dropped | longest wait | machine |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for is_ordinary in (True, False) * 2:
        print(f"| {' | '.join(row(is_ordinary, seconds, loops))} |", flush=True)


if __name__ == "__main__":
    main()
