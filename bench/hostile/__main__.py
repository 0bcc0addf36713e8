"""Hostile clients, one kind after the other, beside a client that behaves well.

python -m bench.hostile [SECONDS in all, default 60]

One daemon holds the simulated gripper at 200 Hz, as a process of its own, and notes how late each
tick is; a polite client reads the state again and again, after pauses of 0 to 4 ms, and makes small
motions. `quiet` is that alone, at the beginning and at the end; `x` is a figure's ratio to that of
both. The polite client runs at real-time priority below the daemon's, so that what is measured is
the daemon rather than the scheduler's choice between clients. `machine` is
`bench.timing.reference`, a bare loop, in the same phase. Wrong answers and broken promises end the
benchmark with an error.
"""

import array
import bisect
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.__main__ import output_of, run_module, wait_for
from bench.hostile.clients import KINDS
from bench.hostile.polite import Polite
from litegripd.app.main import main as run_daemon
from litegripd.io import loop
from litegripd.io.meters import RecentLateness
from litegripd.io.realtime import acquire

PRIORITY = 49
PAUSE_S = 0.004
SHARES = (0.5, 0.99, 0.999)
UIDS = ("30001", "30002", "30003", "30004") if os.getuid() == 0 else ()
CONFIG = '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n'
ALL = "all at once"
HEADER = (
    f"{'':<17}{'ticks late: p50':>15}{'x':>6}{'p99':>8}{'x':>6}{'p99.9':>8}{'x':>6}{'lost':>6}"
    f"{'reads':>8}{'p50':>7}{'x':>6}{'p99':>8}{'x':>6}{'motions':>9}   machine: p99, p99.9, lost"
)


class NotedLateness(RecentLateness):
    """Notes the lateness of every tick, and when it was."""

    notes = array.array("d")

    def add(self, now_s: float, duration_s: float) -> None:
        super().add(now_s, duration_s)
        self.notes.extend((now_s, duration_s))


@dataclass(frozen=True, slots=True)
class Phase:
    """What was measured in one phase."""

    name: str
    began_s: float
    ended_s: float
    lost_ticks: int
    motions: int
    reads_s: list[float]
    machine: dict[str, float]


def daemon(notes: str, *arguments: str) -> int:
    """Be the daemon, with a loop that notes its lateness."""
    vars(loop)["RecentLateness"] = NotedLateness
    code = run_daemon(arguments)
    Path(notes).write_bytes(NotedLateness.notes.tobytes())
    return code


@contextlib.contextmanager
def hostile_clients(path: Path, kinds: Sequence[str]) -> Iterator[None]:
    """Let a client of each kind be there; a crowd, for as many users as there may be."""
    processes: list[subprocess.Popen[str]] = []
    try:
        for kind in kinds:
            users = [[uid] for uid in UIDS[: 1 if len(kinds) > 1 else None]]
            for user in users if users and kind == "crowd" else [[]]:
                command = [sys.executable, "-m", "bench.hostile.clients", kind, str(path), *user]
                pipe = subprocess.PIPE
                processes.append(subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True))
        for process in processes:
            if process.stdout is None or process.stdout.readline() != "on\n":
                raise RuntimeError("a hostile client has ended; it says above why")
        yield
        for process in processes:
            process.communicate()
            if process.returncode != 0:
                raise RuntimeError("a promise was broken; it is said above which")
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def measure(name: str, kinds: Sequence[str], path: Path, polite: Polite, seconds: float) -> Phase:
    """Run one phase; wait afterwards until the polite client is alone again."""
    with hostile_clients(path, kinds):
        machine = run_module("bench.timing.reference", seconds)
        lost, motions = polite.result("health")["control"]["lost_ticks"], polite.motions
        reads, began_s = len(polite.latencies_s), time.monotonic()
        polite.work(lambda: time.monotonic() >= began_s + seconds, PAUSE_S)
        ended_s = time.monotonic()
        lost = polite.result("health")["control"]["lost_ticks"] - lost
        noise = output_of(machine)
    polite.until("health", lambda health: bool(health["rpc"]["clients"] == 1))
    reads_s = sorted(polite.latencies_s[reads:])
    return Phase(name, began_s, ended_s, lost, polite.motions - motions, reads_s, noise)


def us(ordered: Sequence[float], shares: Sequence[float]) -> list[float]:
    """Return the percentiles of sorted seconds in microseconds."""
    return [ordered[int(share * (len(ordered) - 1))] * 1e6 for share in shares]


def lateness_s(phases: Sequence[Phase], notes: "array.array[float]") -> list[float]:
    """Return how late the ticks of some phases were, sorted."""
    times = notes[::2]
    found: list[float] = []
    for phase in phases:
        begin, end = (bisect.bisect(times, at_s) for at_s in (phase.began_s, phase.ended_s))
        found += notes[2 * begin + 1 : 2 * end : 2]
    return sorted(found)


def row(phase: Phase, quiet: Sequence[Phase], notes: "array.array[float]") -> str:
    """Return the figures of a phase beside those of the quiet ones."""
    late = us(lateness_s([phase], notes), SHARES)
    late_quiet = us(lateness_s(quiet, notes), SHARES)
    reads = us(phase.reads_s, SHARES[:2])
    reads_quiet = us(sorted(read_s for one in quiet for read_s in one.reads_s), SHARES[:2])
    widths = ((15, 6), (8, 6), (8, 6), (7, 6), (8, 6))
    cells = [
        f"{one:>{wide}.0f}{one / other:>{narrow}.1f}"
        for one, other, (wide, narrow) in zip(
            late + reads, late_quiet + reads_quiet, widths, strict=True
        )
    ]
    machine = phase.machine
    noise = f"{machine['p99_us']:.0f}, {machine['p99_9_us']:.0f}, {machine['lost']:.0f}"
    return (
        f"{phase.name:<17}{''.join(cells[:3])}{phase.lost_ticks:>6}{len(phase.reads_s):>8}"
        f"{''.join(cells[3:])}{phase.motions:>9}   {noise}"
    )


def run(seconds: float) -> tuple[list[Phase], "array.array[float]", int]:
    """Run all phases; return them, the daemon's notes, and how often the motor lost its power."""
    plan = [("quiet", []), *((kind, [kind]) for kind in KINDS), (ALL, list(KINDS)), ("quiet", [])]
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        folder.chmod(0o755)  # for other users, as is the socket
        path, file, config = folder / "bench.sock", folder / "notes", folder / "config.toml"
        config.write_text(CONFIG, encoding="utf-8")
        arguments = ("bench", "--config", config, "--socket", path)
        process = run_module("bench.hostile", "--daemon", file, *arguments)
        stack.callback(process.kill)
        wait_for(path)
        path.chmod(0o666)
        polite = stack.enter_context(Polite(path))
        fds = Path(f"/proc/{process.pid}/fd")
        polite.until("health", lambda h: bool(h["rpc"]["clients"] == 1 and h["helper"]["pid"]))
        open_before = len(list(fds.iterdir()))
        phases = [measure(name, kinds, path, polite, seconds / len(plan)) for name, kinds in plan]
        control = polite.result("health")["control"]
        left = len(list(fds.iterdir())) - open_before
        if left or control["tick_errors"]:
            raise RuntimeError(f"{left} descriptors are left; {control['tick_errors']} tick errors")
        process.send_signal(signal.SIGTERM)
        process.communicate()
        notes = array.array("d", file.read_bytes())
    return phases, notes, polite.power_losses


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    refused = acquire(PRIORITY, ()).refused
    print(f"{seconds:g} s in all; microseconds; x: times the quiet phases'")
    print("".join(f"the polite client was not granted {right}\n" for right in refused), end="")
    phases, notes, power_losses = run(seconds)
    quiet = [phase for phase in phases if phase.name == "quiet"]
    print(HEADER)
    for phase in phases:
        print(row(phase, quiet, notes))
    print(f"the motor's watchdog acted {power_losses} times")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--daemon"]:
        sys.exit(daemon(*sys.argv[2:]))
    main()
