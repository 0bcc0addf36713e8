"""A crowd at one daemon: 50 processes that move, wait, hang, die and come back at random.

python -m bench.crowd [SECONDS, default 300] [SEED, default 1]

Each client is a process (`bench.crowd.client`). They are stopped (SIGSTOP) and go on, are killed
and come back as new ones; mostly whoever has the lease or moves is killed. All that the daemon
tells is audited (`bench.crowd.audit`). For each loss three times count from just before `kill`: to
the daemon's own stamp of its event (`event`); to the begin of the tick whose frame does what
`on_lost` says (`in force`), which has the resolution of a tick, 5 ms; and to the process's end in
the kernel (`over`): its socket is closed shortly before, and the daemon cannot know earlier.
`untimed` are those where a motion had to end first, or the tick was not seen. `machine` is a bare
loop.
"""

import contextlib
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from bench.__main__ import output_of, run_module, wait_for
from bench.crowd.audit import Loss, Tenure
from bench.crowd.driver import PRIORITY
from bench.crowd.run import Outcome, survive
from litegripd.io.realtime import acquire

CLIENTS = 50
LIMIT_S = 0.010
WARM_UP_S = 20.0
CONFIG = '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n'


def measure(seconds: float, seed: int) -> tuple[Outcome, dict[str, float], str]:
    """Run a daemon and its crowd; return the outcome, the machine's noise and the daemon's log."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        path, config, log = folder / "crowd.sock", folder / "config.toml", folder / "log.txt"
        config.write_text(CONFIG, encoding="utf-8")
        command = [sys.executable, "-m", "litegripd.app.main", "crowd"]
        command += ["--config", str(config), "--socket", str(path)]
        with log.open("wb") as file:
            daemon = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file)
        stack.callback(daemon.kill)
        wait_for(path)
        machine = run_module("bench.timing.reference", seconds)
        stack.callback(machine.kill)
        outcome = survive(path, daemon.pid, CLIENTS, seconds, seed)
        noise = output_of(machine)
        daemon.send_signal(signal.SIGTERM)
        if daemon.wait(10.0):
            outcome.complaints.append(f"the daemon ended with {daemon.returncode}")
        text = log.read_text(encoding="utf-8")
    if "Traceback" in text:
        outcome.complaints.append("the daemon's log has a traceback")
    return outcome, noise, text


def spread_ms(seconds: list[float]) -> str:
    """Return p50, p99 and the worst."""
    ordered = sorted(seconds)
    if not ordered:
        return f"{'-':>8}{'-':>8}{'-':>8}"
    return "".join(f"{ordered[int(q * (len(ordered) - 1))] * 1e3:>8.2f}" for q in (0.5, 0.99, 1.0))


def loss_rows(losses: list[Loss]) -> list[str]:
    """Return the table of the losses, by what was wished, and those that came late."""
    over = f"> {LIMIT_S * 1e3:g} ms"
    rows = [f"{'ms from kill (p50, p99, worst)':<39}{'event':>17}{'in force':>24}{'over':>24}"]
    rows[0] += f"{over:>9}{'untimed':>9}"
    for name in ("hold", "relax", "disable", "all"):
        some = [loss for loss in losses if name in ("all", loss.on_lost)]
        ends = [(loss.in_force_s, loss.death.at_s) for loss in some]
        in_force = [ends_s - at_s for ends_s, at_s in ends if ends_s is not None]
        spreads = spread_ms([loss.told_s - loss.death.at_s for loss in some])
        spreads += spread_ms(in_force)
        spreads += spread_ms([loss.death.over_s - loss.death.at_s for loss in some])
        late = sum(one > LIMIT_S for one in in_force)
        label = f"on_lost {name}, {len(some)} losses"
        rows.append(f"{label:<32}{spreads}{late:>9}{len(some) - len(in_force):>9}")
    after = max((loss.told_s - loss.death.over_s for loss in losses), default=0.0)
    rows += [row for loss in losses for row in _late_row(loss)]
    return [*rows, f"the latest event came {after * 1e3:.2f} ms after the end of its process"]


def _late_row(loss: Loss) -> list[str]:
    at_s, in_force_s = loss.death.at_s, loss.in_force_s
    if in_force_s is None or in_force_s - at_s <= LIMIT_S:
        return []
    times = (loss.told_s, in_force_s, loss.death.over_s)
    told, in_force, over = (f"{(time_s - at_s) * 1e3:.2f} ms" for time_s in times)
    row = f"  late: over after {over}, told after {told}, {loss.on_lost} after {in_force}"
    return [f"{row}; longest time between two ticks meanwhile {loss.gap_s * 1e3:.1f} ms"]


def slope_mb_min(points: list[tuple[float, float]]) -> float:
    """Return by how much memory grows, by least squares."""
    mean_s = sum(at_s for at_s, _ in points) / len(points)
    mean_mb = sum(mb for _, mb in points) / len(points)
    spread = sum((at_s - mean_s) ** 2 for at_s, _ in points)
    return 60.0 * sum((at_s - mean_s) * (mb - mean_mb) for at_s, mb in points) / spread


def report(outcome: Outcome, noise: dict[str, float]) -> list[str]:
    """Return the figures, a line each."""
    motions, health, memory = outcome.audit.motions, outcome.health, outcome.memory
    control, lateness = health["control"], health["control"]["lateness"]
    ends = Counter(motion.reason or str(motion.state) for motion in motions.values())
    warm = [point for point in memory[:-1] if point[0] >= min(WARM_UP_S, outcome.seconds / 3)]
    noisy = f"machine: lost {noise['lost']:.0f}, p99 {noise['p99_us']:.0f} µs"
    ticks = f"ticks: {control['ticks']}, lost {control['lost_ticks']}"
    ticks += f", late p99 {lateness['p99_us']:.0f} µs, worst {lateness['worst_us']:.0f} µs"
    requests = f"requests: {health['rpc']['requests']}"
    requests += f", periods without time left for more: {health['rpc']['budget_exhausted']}"
    requests += f", late shares: {health['rpc']['late_shares']}"
    requests += f", refused connections: {health['rpc']['refused_connections']}"
    requests += f", log lines dropped: {health['log']['dropped']}"
    requests += f", samples not sent to the watcher: {outcome.dropped_samples}"
    requests += f" (losses not seen by that: {outcome.audit.unseen})"
    resident = f"resident MB: {memory[0][1]:.1f} at the begin, {warm[0][1]:.1f} warmed up"
    resident += f" at {warm[0][0]:.0f} s, {memory[-2][1]:.1f} at the end, {memory[-1][1]:.1f}"
    resident += f" when all have left; slope {slope_mb_min(warm):+.2f} MB a minute"
    tenures = outcome.audit.tenures
    return [
        f"{len(motions)} motions, {len(tenures)} leases; they ended: {_counts(_causes(tenures))}",
        f"{outcome.deaths} processes killed, {outcome.stops} stopped for a while",
        f"motions ended: {_counts(ends)}",
        f"refused: {_counts(Counter(outcome.audit.refused))}",
        *loss_rows(outcome.losses),
        f"{ticks}; {noisy}, worst {noise['worst_us']:.0f} µs",
        requests,
        f"descriptors: {outcome.descriptors[0]} before, {outcome.descriptors[1]} after",
        resident,
        f"health: {health['verdict']} {health['reasons']}",
    ]


def _causes(tenures: list[Tenure]) -> Counter[str]:
    return Counter(str(tenure.cause) for tenure in tenures)


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counter.most_common())


def main() -> int:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    refused = acquire(PRIORITY, ()).refused
    print("".join(f"the driver was not granted {right}\n" for right in refused), end="")
    print(f"{CLIENTS} clients for {seconds:g} s, seed {seed}", flush=True)
    outcome, noise, log = measure(seconds, seed)
    print("\n".join(report(outcome, noise)))
    for complaint in outcome.complaints[:20]:
        print(f"COMPLAINT: {complaint}")
    if outcome.complaints:
        print(f"{len(outcome.complaints)} complaints; the end of the daemon's log:\n{log[-8000:]}")
    return 1 if outcome.complaints else 0


if __name__ == "__main__":
    sys.exit(main())
