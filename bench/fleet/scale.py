"""States of many grippers through one gateway, one router and one portal to one reader, with TLS.

python -m bench.fleet.scale [SECONDS per row, default 10] [GRIPPERS,... default 1,10,50,200]
                            [HZ,... default 10,50]

The grippers are `bench.fleet.standin`, in one process, with samples as a daemon sends them; all
else is as in reality, but on one machine: all five processes share its cores. Age: from the
stand-in's write to the reader's read, by CLOCK_MONOTONIC. `lost` is the share of what GRIPPERS
times HZ should bring that did not come, `ended` the sessions that ended. CPU is in % of one core.
"""

import contextlib
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from bench.fleet.recorded import record
from bench.fleet.standin import name_of
from bench.fleet.usage import Usage, usage_of
from tests.process.fleet.fleet_process import HOST, Fleet, make_certificates, reach

USER, TTL_S = "op1", 1.0
SETTLE_S = 3.0
PARTS = ("stand-in", "gateway", "router", "portal", "reader")


def started(module: str, *arguments: object) -> "subprocess.Popen[str]":
    """Start a module of the bench that then listens to standard input, and says what it does."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def said(process: "subprocess.Popen[str]") -> str:
    """Return the next line of a process; raises `RuntimeError` at its end."""
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise RuntimeError(f"{process.args!r:.200} has ended")
    return line.strip()


def kill_all(fleet: Fleet) -> None:
    """End all parts of a fleet, at once."""
    for part in fleet.parts.values():
        part.kill()


class Row:
    """One size and rate: what came, and what each process used."""

    def __init__(self, grippers: int, hz: float, seconds: float, figures: dict[str, Any]) -> None:
        self.grippers = grippers
        self.hz = hz
        self.seconds = seconds
        self.figures = figures
        self.used: dict[str, tuple[Usage, Usage]] = {}

    def text(self) -> str:
        offered = self.grippers * self.hz * self.seconds
        came = self.figures["samples"]
        ages = [self.figures.get(name, float("nan")) / 1e3 for name in ("p50", "p99", "worst")]
        cells = f"{self.grippers:>8}{self.hz:>5g}{came / self.seconds:>11.0f}"
        cells += f"{max(0.0, 1.0 - came / offered):>8.2%}{self.figures['ended']:>7}"
        cells += "".join(f"{age_ms:>9.2f}" for age_ms in ages) + "  "
        for before, after in self.used.values():
            cells += f"{(after.cpu_s - before.cpu_s) / self.seconds:>9.0%}"
        cells += "  "
        for _before, after in self.used.values():
            cells += f"{after.resident_kb / 1024:>9.0f}"
        return cells


HEADER = (
    f"{'grippers':>8}{'Hz':>5}{'samples/s':>11}{'lost':>8}{'ended':>7}"
    f"{'p50 ms':>9}{'p99':>9}{'worst':>9}  "
    + "".join(f"{name:>9}" for name in PARTS)
    + "  "
    + "".join(f"{name:>9}" for name in PARTS)
)


class Scale:
    """Certificates and recorded answers, for all rows."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.recorded = folder / "recorded.json"
        record(self.recorded)
        names = (HOST, f"user:{USER}", "gateway:robot1")
        self.certificates = make_certificates(folder / "tls", *names)

    def rows(self, grippers: int, rates_hz: list[float], seconds: float) -> None:
        """Run a fleet of so many grippers, and print a row for each rate."""
        with contextlib.ExitStack() as stack:
            short = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="scale-")))
            logs = self.folder / str(grippers)
            logs.mkdir()
            standins = short / "standins"
            standins.mkdir()
            standin = started("bench.fleet.standin", self.recorded, standins, grippers)
            stack.callback(standin.kill)
            said(standin)
            names = [name_of(index) for index in range(grippers)]
            fleet = Fleet(logs, short, self.certificates)
            stack.callback(kill_all, fleet)
            fleet.start_router({USER: "operator"}, {"robot1": names})
            fleet.start_gateway({name: standins / f"{name}.sock" for name in names})
            fleet.start_portal(USER, "operator", names, TTL_S)
            for name in names:
                reach(fleet, name).close()
            pids = {"stand-in": standin.pid}
            pids |= {kind: fleet.parts[kind].process.pid for kind in PARTS if kind in fleet.parts}
            for hz in rates_hz:
                paths = [fleet.socket_path(name) for name in names]
                print(self.row(hz, seconds, paths, pids).text(), flush=True)

    def row(self, hz: float, seconds: float, paths: list[Path], pids: dict[str, int]) -> Row:
        reader = started("bench.fleet.reader", hz, *paths)
        try:
            said(reader)
            time.sleep(SETTLE_S)
            pids = {**pids, "reader": reader.pid}
            before = {name: usage_of(pid) for name, pid in pids.items()}
            assert reader.stdin is not None
            reader.stdin.write(f"{seconds}\n")
            reader.stdin.flush()
            figures = json.loads(said(reader))
            row = Row(len(paths), hz, seconds, figures)
            row.used = {name: (before[name], usage_of(pid)) for name, pid in pids.items()}
            return row
        finally:
            reader.kill()
            reader.wait()


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    sizes = [int(text) for text in (sys.argv[2] if len(sys.argv) > 2 else "1,10,50,200").split(",")]
    rates = [float(text) for text in (sys.argv[3] if len(sys.argv) > 3 else "10,50").split(",")]
    print(f"{'':>64}CPU of{'':<40}resident MB of")
    print(HEADER, flush=True)
    with tempfile.TemporaryDirectory(prefix="scale-") as name:
        scale = Scale(Path(name))
        for grippers in sizes:
            scale.rows(grippers, rates, seconds)


if __name__ == "__main__":
    main()
