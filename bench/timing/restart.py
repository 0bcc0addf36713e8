"""How long the motor waits for a command while one daemon follows another that holds a force.

python -m bench.timing.restart [RESTARTS, default 10]

A daemon over SLCAN holds an object with 8 N; the simulator notes when each command came. Pump and
simulator get real-time priority where that is allowed, so that the figures are the daemons'. The
gaps of the same run away from any restart tell what of it is this machine's own noise.
"""

import array
import os
import signal
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from bench.__main__ import call, enable, run_module, wait_for
from bench.timing.tapped_simulator import prefer
from tests.process.daemon_process import SLCAN

AROUND_S = 0.15
SETTLE_S = 1.0
PERIOD_S = 0.005
OBJECT_MM = 40.0
FORCE_N = 8.0


class Restart(NamedTuple):
    """When one began and ended, how long it took, and the successor's first ticks."""

    began_s: float
    ended_s: float
    took_s: float
    gap_ms: float
    worst_tick_ms: float
    lost_ticks: int


def pump_of(pid: int) -> int:
    """Return the pump's pid; the helper stays ordinary, for a successor inherits its priority."""
    pumps = [child for child in descendants(pid) if b"pump_main" in command_line(child)]
    if not pumps:
        raise RuntimeError("the daemon has no pump")
    return pumps[0]


def descendants(pid: int) -> list[int]:
    """Return the processes that a process has started, and theirs."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    children = [int(child) for child in path.read_text(encoding="ascii").split()]
    return children + [other for child in children for other in descendants(child)]


def command_line(pid: int) -> bytes:
    return Path(f"/proc/{pid}/cmdline").read_bytes()


def result(path: Path, method: str, **params: Any) -> dict[str, Any]:
    answer = call(path, method, **params)
    if "error" in answer:
        raise RuntimeError(f"{method}: {answer['error']['message']}")
    found: dict[str, Any] = answer["result"]
    return found


def grip(path: Path) -> None:
    """Hold the object; what a busy machine interrupts is tried again."""
    ends_s = time.monotonic() + 60.0
    while True:
        enable(path)
        call(path, "motion.grasp", force_n=FORCE_N, until="verdict", detach=True)
        time.sleep(SETTLE_S)
        state = result(path, "state.get")
        if state["force_n"] and abs(state["force_n"] - FORCE_N) < 0.5 * FORCE_N:
            return
        if time.monotonic() > ends_s:
            raise RuntimeError(f"nothing is held: {state}")


def measure(restarts: int, folder: Path) -> tuple[list[Restart], "array.array[float]"]:
    """Restart so often; return when each began, ended, and took, and what the simulator noted."""
    rows_path, socket_path = folder / "rows", folder / "bench.sock"
    simulator = run_module("bench.timing.tapped_simulator", rows_path, OBJECT_MM)
    if simulator.stdout is None:
        raise RuntimeError("the simulator's output is not piped")
    config = folder / "config.toml"
    config.write_text(SLCAN.format(channel=simulator.stdout.readline().strip()), encoding="utf-8")
    daemon: subprocess.Popen[str] = run_module(
        "litegripd.app.main", "bench", "--config", config, "--socket", socket_path
    )
    spans = []
    pid = daemon.pid
    try:
        wait_for(socket_path)
        time.sleep(SETTLE_S)
        print(f"pump and simulator with real-time priority: {prefer(pump_of(pid))}")
        for _ in range(restarts):
            grip(socket_path)
            began_s = time.monotonic()
            restarted = result(socket_path, "daemon.restart", hold_through_restart=True)
            pid = restarted["pid"]
            ended_s = time.monotonic()
            wait_for(socket_path)
            took_s = time.monotonic() - began_s
            time.sleep(SETTLE_S)
            control = result(socket_path, "health")["control"]
            worst_ms = control["lateness"]["worst_us"] / 1e3
            spans.append(
                Restart(
                    began_s,
                    ended_s,
                    took_s,
                    restarted["gap_s"] * 1e3,
                    worst_ms,
                    control["lost_ticks"],
                )
            )
    finally:
        os.kill(pid, signal.SIGTERM)
        daemon.communicate()
        time.sleep(SETTLE_S)
        simulator.send_signal(signal.SIGTERM)
        simulator.communicate()
    rows = array.array("d")
    rows.frombytes(rows_path.read_bytes())
    return spans, rows


def main() -> None:
    restarts = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    with tempfile.TemporaryDirectory() as name:
        spans, rows = measure(restarts, Path(name))
    commands = list(zip(rows[0::4], rows[1::4], rows[2::4], rows[3::4], strict=True))
    gaps = [(later[0], later[0] - earlier[0]) for earlier, later in pairwise(commands)]
    print(
        f"{len(commands)} commands, one every {PERIOD_S * 1e3:g} ms. Per restart: how long it took,"
    )
    print("the gap between the two daemons' commands as they were sent, the successor's worst tick")
    print(
        "and lost ticks in its first second, and as the motor saw it: the longest gap of all, the"
    )
    print("torque, how far the jaws moved, and whether the motor stayed energised.")
    for span in spans:
        ends_s = span.ended_s + AROUND_S
        around = [c for c in commands if span.began_s <= c[0] <= ends_s]
        longest_s = max(gap for at_s, gap in gaps if span.began_s <= at_s <= ends_s)
        torques, jaws = [c[1] for c in around], [c[2] for c in around]
        print(
            f"{span.took_s * 1e3:>6.0f} ms{span.gap_ms:>7.2f} ms{span.worst_tick_ms:>7.2f} ms"
            f"{span.lost_ticks:>4}  motor:{longest_s * 1e3:>7.2f} ms"
            f"{min(torques):>7.3f}-{max(torques):.3f} N·m{max(jaws) - min(jaws):>7.3f} mm"
            f"  {'on' if all(c[3] for c in around) else 'OFF'}"
        )
    quiet = sorted(gap for at_s, gap in gaps if is_quiet(at_s, spans) and gap < SETTLE_S)
    print(
        f"the motor's gaps away from restarts: p99 {quiet[int(0.99 * len(quiet))] * 1e3:.2f} ms,"
        f" p99.9 {quiet[int(0.999 * len(quiet))] * 1e3:.2f} ms, worst {quiet[-1] * 1e3:.2f} ms"
    )


def is_quiet(at_s: float, spans: list[Restart]) -> bool:
    return not any(s.began_s - AROUND_S <= at_s <= s.ended_s + 2 * AROUND_S for s in spans)


if __name__ == "__main__":
    main()
