"""Ticks under load: the daemon beside a plain two-thread server and the vendor's pacing.

python -m bench [SECONDS per case, default 60]

Each case has a daemon of its own that holds the simulated gripper enabled at 200 Hz, and beside
it `machine`, a bare loop that does nothing, as a measure of this machine's own noise.
"""

import array
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CLIENT_COUNTS = (0, 1, 8, 32)
MARGIN_S = 1.0
START_WITHIN_S = 20.0
HEADER = (
    f"{'case':<22}{'p50':>7}{'p99':>7}{'p99.9':>8}{'worst':>8}{'lost':>6}{'requests/s':>12}"
    f"{'read p50':>10}{'read p99':>10}{'CPU':>7}{'MB':>6}   machine: p99.9, worst, lost"
)


@dataclass(frozen=True, slots=True)
class Row:
    """The figures of one case; times in microseconds."""

    case: str
    lateness: dict[str, float]
    lost_ticks: int
    machine: dict[str, float]
    requests_s: float | None = None
    reads: tuple[float, float] | None = None
    cpu_share: float | None = None
    resident_mb: float | None = None

    def text(self) -> str:
        late = self.lateness
        cells = "".join(f"{late[name]:>7.0f}" for name in ("p50_us", "p99_us"))
        cells += f"{late['p99_9_us']:>8.0f}{late['worst_us']:>8.0f}{self.lost_ticks:>6}"
        cells += f"{'-' if self.requests_s is None else format(self.requests_s, '.0f'):>12}"
        p50, p99 = (format(us, ".0f") for us in self.reads) if self.reads else ("-", "-")
        cells += f"{p50:>10}{p99:>10}"
        cells += f"{'-' if self.cpu_share is None else format(self.cpu_share, '.1%'):>7}"
        cells += f"{'-' if self.resident_mb is None else format(self.resident_mb, '.0f'):>6}"
        machine = self.machine
        noise = f"{machine['p99_9_us']:.0f}, {machine['worst_us']:.0f}, {machine['lost']:.0f}"
        return f"{self.case:<22}{cells}   {noise}"


def run_module(module: str, *arguments: object) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def output_of(process: "subprocess.Popen[str]") -> dict[str, Any]:
    """Wait for a process to end; return the JSON of its last line."""
    figures: dict[str, Any] = json.loads(process.communicate()[0].splitlines()[-1])
    return figures


def call(path: Path, method: str, **params: Any) -> dict[str, Any]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connected:
        connected.connect(str(path))
        request = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
        connected.sendall(json.dumps(request).encode() + b"\n")
        with connected.makefile("rb") as lines:
            answer: dict[str, Any] = json.loads(lines.readline())
    return answer


def enable(path: Path) -> None:
    """Enable the motor as soon as the daemon has found it."""
    ends_s = time.monotonic() + START_WITHIN_S
    while not call(path, "motor.enable", detach=True).get("result", {}).get("ok"):
        if time.monotonic() > ends_s:
            raise RuntimeError("the motor cannot be enabled")


def percentiles_us(files: list[Path]) -> tuple[float, float]:
    latencies = array.array("d")
    for file in files:
        latencies.frombytes(file.read_bytes())
    ordered = sorted(latencies)
    return tuple(ordered[int(share * (len(ordered) - 1))] * 1e6 for share in (0.5, 0.99))  # type: ignore[return-value]


def cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def start_clients(path: Path, folder: Path, count: int, seconds: float) -> list[Path]:
    files = [folder / f"latencies-{number}" for number in range(count)]
    clients = [run_module("bench.timing.client", path, seconds, file) for file in files]
    for client in clients:
        client.communicate()
    return files


def daemon_case(clients: int, seconds: float, unread: bool = False) -> Row:
    """Measure the daemon with so many clients, one of which may never read."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        path = folder / "bench.sock"
        daemon = run_module("litegripd.app.main", "bench", "--simulate", "--socket", path)
        stack.callback(daemon.kill)
        wait_for(path)
        enable(path)
        machine = run_module("bench.timing.reference", seconds)
        before_s, began_s = cpu_seconds(daemon.pid), time.monotonic()
        deaf = (
            [run_module("bench.timing.client", path, seconds, "-", "--never-read")]
            if unread
            else []
        )
        if clients:
            files = start_clients(path, folder, clients, seconds)
        noise = output_of(machine)
        share = (cpu_seconds(daemon.pid) - before_s) / (time.monotonic() - began_s)
        for process in deaf:
            process.communicate()
        health = call(path, "health")["result"]
        daemon.send_signal(signal.SIGTERM)
        daemon.communicate()
        return Row(
            case=f"litegripd, {clients} clients" + (" + deaf" if unread else ""),
            lateness=health["control"]["lateness"],
            lost_ticks=health["control"]["lost_ticks"],
            machine=noise,
            requests_s=health["rpc"]["requests"] / seconds if clients else None,
            reads=percentiles_us(files) if clients else None,
            cpu_share=share,
            resident_mb=health["control"]["resident_mb"],
        )


def asyncio_case(clients: int, seconds: float) -> Row:
    """Measure the two-thread server with so many clients."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "bench.sock"
        server = run_module("bench.timing.asyncio_server", path, seconds + MARGIN_S)
        wait_for(path)
        machine = run_module("bench.timing.reference", seconds)
        files = start_clients(path, folder, clients, seconds)
        noise = output_of(machine)
        figures = output_of(server)
        return Row(
            case=f"asyncio, {clients} clients",
            lateness=figures["lateness"],
            lost_ticks=figures["lost_ticks"],
            machine=noise,
            requests_s=figures["requests"] / seconds,
            reads=percentiles_us(files) if clients else None,
        )


def vendor_case(seconds: float) -> Row:
    """Measure the vendor's pacing, alone."""
    machine = run_module("bench.timing.reference", seconds)
    figures = output_of(run_module("bench.timing.vendor_pacing", seconds))
    return Row("vendor's pacing", figures["lateness"], figures["lost_ticks"], output_of(machine))


def wait_for(path: Path, within_s: float = START_WITHIN_S) -> None:
    """Wait until somebody listens on a socket."""
    ends_s = time.monotonic() + within_s
    while True:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            try:
                probe.connect(str(path))
            except OSError:
                if time.monotonic() > ends_s:
                    raise
                time.sleep(0.02)
                continue
        return


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    print(f"{seconds:g} s a case at 200 Hz; lateness of ticks and latency of reads in µs")
    print(HEADER, flush=True)
    for clients in CLIENT_COUNTS:
        print(daemon_case(clients, seconds).text(), flush=True)
    print(daemon_case(8, seconds, unread=True).text(), flush=True)
    for clients in CLIENT_COUNTS:
        print(asyncio_case(clients, seconds).text(), flush=True)
    print(vendor_case(seconds).text(), flush=True)


if __name__ == "__main__":
    main()
