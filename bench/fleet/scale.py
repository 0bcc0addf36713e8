"""States of many grippers through one gateway, one router and one portal to one reader, with TLS.

python -m bench.fleet.scale [SECONDS per row, default 10] [GRIPPERS,... default 1,10,50,200]
                            [HZ,... default 10,50] [MACHINES, default 1]

The grippers are `bench.fleet.standin`, in one process, with samples as a daemon sends them; all
else is as in reality, but on one machine: all processes share its cores. MACHINES have a gateway
each, for their part of the grippers; `gateway` is what all of these use. Age: from the
stand-in's write to the reader's read, by CLOCK_MONOTONIC. `lost` is the share of what GRIPPERS
times HZ should bring that did not come, late ones of a machine that has other work included;
`gaps` are the numbers that were left out between those that came; `ended` the sessions that ended.
CPU is in % of one core.

Behind each row comes the floor under it, in the same run and by the same router: as many payloads
of the same size from a zenoh publisher to a subscriber, and nothing else (`bench.fleet.floor`). Its
publisher stands below `gateway`, its subscriber below `portal`. `each` is the CPU that one sample
took in gateway, router and portal, in µs: it can be compared where the machine has other work.
"""

import contextlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.fleet.recorded import record
from bench.fleet.standin import Answers, name_of
from bench.fleet.usage import usage_of
from tests.process.fleet.fleet_process import HOST, Fleet, make_certificates, reach

USER, TTL_S = "op1", 1.0
Pids = dict[str, list[int]]
"""Of each part's processes."""

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


@contextlib.contextmanager
def ended_then(process: "subprocess.Popen[str]") -> Iterator["subprocess.Popen[str]"]:
    """Kill a process at the end."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def usage_of_all(pids: list[int]) -> tuple[float, int]:
    """Return what processes have used of CPU, in seconds, and use of memory, in kB."""
    used = [usage_of(pid) for pid in pids]
    return sum(one.cpu_s for one in used), sum(one.resident_kb for one in used)


class Row:
    """One size and rate: what came, and what each process used."""

    def __init__(
        self, kind: str, grippers: int, hz: float, seconds: float, figures: dict[str, Any]
    ) -> None:
        self.kind = kind
        self.grippers = grippers
        self.hz = hz
        self.seconds = seconds
        self.figures = figures
        self.used: dict[str, tuple[tuple[float, int], tuple[float, int]]] = {}

    def text(self) -> str:
        offered = self.grippers * self.hz * self.seconds
        came = self.figures["samples"]
        ages = [self.figures.get(name, float("nan")) / 1e3 for name in ("p50", "p99", "worst")]
        cells = f"{self.kind:<6}{self.grippers:>8}{self.hz:>5g}{came / self.seconds:>11.0f}"
        cells += f"{max(0.0, 1.0 - came / offered):>8.2%}"
        cells += f"{self.figures['missing']:>7}{self.figures['ended']:>7}"
        cells += "".join(f"{age_ms:>9.2f}" for age_ms in ages) + "  "
        for name in PARTS:
            share = ""
            if name in self.used:
                before, after = self.used[name]
                share = f"{(after[0] - before[0]) / self.seconds:.0%}"
            cells += f"{share:>9}"
        used_s = sum(
            after[0] - before[0]
            for name, (before, after) in self.used.items()
            if name not in ("stand-in", "reader")
        )
        cells += f"{used_s / max(1, came) * 1e6:>7.0f}  "
        for name in PARTS:
            resident = round(self.used[name][1][1] / 1024) if name in self.used else ""
            cells += f"{resident:>9}"
        return cells


HEADER = (
    f"{'':<6}{'grippers':>8}{'Hz':>5}{'samples/s':>11}{'lost':>8}{'gaps':>7}{'ended':>7}"
    f"{'p50 ms':>9}{'p99':>9}{'worst':>9}  "
    + "".join(f"{name:>9}" for name in PARTS)
    + f"{'each':>7}  "
    + "".join(f"{name:>9}" for name in PARTS)
)


class Scale:
    """Certificates and recorded answers, for all rows."""

    def __init__(self, folder: Path, machines: int) -> None:
        self.folder = folder
        self.robots = [f"robot{number}" for number in range(1, machines + 1)]
        self.recorded = folder / "recorded.json"
        record(self.recorded)
        answers = Answers(json.loads(self.recorded.read_text(encoding="utf-8")))
        self.sample_bytes = len(answers.sample(1))
        names = (HOST, f"user:{USER}", *(f"gateway:{robot}" for robot in self.robots))
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
            count = len(self.robots)
            own = {
                robot: names[index * grippers // count : (index + 1) * grippers // count]
                for index, robot in enumerate(self.robots)
            }
            fleet.start_router({USER: "operator"}, own)
            for robot, some in own.items():
                sockets = {name: standins / f"{name}.sock" for name in some}
                fleet.start_gateway(sockets, robot, robot)
            fleet.start_portal(USER, "operator", names, TTL_S)
            for name in names:
                reach(fleet, name).close()
            pids = {"stand-in": [standin.pid]}
            pids["gateway"] = [fleet.parts[robot].process.pid for robot in self.robots]
            pids |= {kind: [fleet.parts[kind].process.pid] for kind in ("router", "portal")}
            for hz in rates_hz:
                paths = [fleet.socket_path(name) for name in names]
                print(self.row(hz, seconds, paths, pids).text(), flush=True)
                print(self.floor(hz, seconds, fleet).text(), flush=True)

    def row(self, hz: float, seconds: float, paths: list[Path], pids: Pids) -> Row:
        """Have all grippers read; return what came."""
        with ended_then(started("bench.fleet.reader", hz, *paths)) as reader:
            pids = {**pids, "reader": [reader.pid]}
            return self._counted("fleet", len(paths), hz, seconds, reader, pids)

    def floor(self, hz: float, seconds: float, fleet: Fleet) -> Row:
        """Have zenoh alone carry as much; return what came."""
        configs = {}
        for name in (USER, "robot1"):
            own = fleet.certificates / name
            values = {"connect": [fleet.endpoint], "ca": f"{own}/ca.pem"}
            values |= {"certificate": f"{own}/own.pem", "key": f"{own}/own.key"}
            configs[name] = fleet.folder / f"{name}.json"
            configs[name].write_text(json.dumps(values), encoding="utf-8")
        count, size = len(fleet.grippers), self.sample_bytes
        with ended_then(started("bench.fleet.floor", "subscribe", configs[USER])) as reader:
            machines = len(self.robots)  # the first one's grippers send for those of all
            options = ("publish", configs["robot1"], -(-count // machines), hz * machines, size)
            with ended_then(started("bench.fleet.floor", *options)) as publisher:
                said(publisher)
                pids = {"gateway": [publisher.pid], "router": [fleet.router.process.pid]}
                pids["portal"] = [reader.pid]
                return self._counted("floor", count, hz, seconds, reader, pids)

    def _counted(
        self,
        kind: str,
        count: int,
        hz: float,
        seconds: float,
        reader: "subprocess.Popen[str]",
        pids: Pids,
    ) -> Row:
        """Have a reader count once it is ready, and look at what all processes use meanwhile."""
        said(reader)
        time.sleep(SETTLE_S)
        before = {name: usage_of_all(some) for name, some in pids.items()}
        assert reader.stdin is not None
        reader.stdin.write(f"{seconds}\n")
        reader.stdin.flush()
        row = Row(kind, count, hz, seconds, json.loads(said(reader)))
        row.used = {name: (before[name], usage_of_all(some)) for name, some in pids.items()}
        return row


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    sizes = [int(text) for text in (sys.argv[2] if len(sys.argv) > 2 else "1,10,50,200").split(",")]
    rates = [float(text) for text in (sys.argv[3] if len(sys.argv) > 3 else "10,50").split(",")]
    machines = int(sys.argv[4]) if len(sys.argv) > 4 else 1
    print(f"{'':>77}CPU of{'':<48}resident MB of")
    print(HEADER, flush=True)
    with tempfile.TemporaryDirectory(prefix="scale-") as name:
        scale = Scale(Path(name), machines)
        for grippers in sizes:
            scale.rows(grippers, rates, seconds)


if __name__ == "__main__":
    main()
