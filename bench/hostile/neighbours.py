"""What a client that behaves well notices of hostile ones: its reads, and its lease.

python -m bench.hostile.neighbours [SECONDS per row, default 5]

One daemon with the simulated gripper at 200 Hz. A reader asks for the state after pauses of 0 to
4 ms, a holder renews a lease of 0.1 s every 30 ms, each by one connection; hostile clients are
other users. `x` is a figure's ratio to that of both idle rows of the same run. Reader and holder
run at real-time priority below the daemon's, so that what is measured is the daemon rather than
the scheduler's choice between clients. It prints the table of docs/architecture.md, and needs to be
root, to become other users.
"""

import contextlib
import json
import os
import random
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.__main__ import run_module, wait_for
from bench.hostile.raw_connection import Connection, reason_of
from litegripd.io.realtime import acquire

PRIORITY = 49
UIDS = ("30001", "30002", "30003")
CONNECTIONS = "64"
PAUSE_S = 0.004
TTL_S, RENEW_S = 0.1, 0.03
STATE_GET = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\n'
RENEW = b'{"jsonrpc":"2.0","id":1,"method":"lease.renew"}\n'
IDLE = "nobody else (before, and after)"


@dataclass(frozen=True, slots=True)
class Attack:
    """What hostile clients do at once: each a module, its arguments, and the user's number."""

    name: str
    clients: tuple[tuple[str, tuple[str, ...]], ...]


def kind(name: str, text: str) -> Attack:
    return Attack(text, (("bench.hostile.clients", (name, "SOCKET", UIDS[0])),))


def floods(count: int, text: str) -> Attack:
    flood = tuple(("bench.hostile.flood", ("SOCKET", CONNECTIONS, uid)) for uid in UIDS[:count])
    return Attack(text, flood)


ATTACKS = (
    floods(1, "one user asks without end, by 64 connections"),
    floods(3, "three users do, by 64 connections each"),
    kind("flooder", "one connection, a hundred requests at once"),
    kind("deaf flooder", "requests whose answers are never read"),
    kind("deaf subscriber", "64 subscriptions at 200 Hz, never read"),
    kind("crowd", "connects without end, all 64 places taken"),
    kind("half open", "connections left in every half-way state"),
    kind("fuzzer", "lines from nearly right to nonsense"),
)


@dataclass(frozen=True, slots=True)
class Row:
    """What the reader and the holder met in one phase; `reads_s` in order of size."""

    name: str
    reads_s: list[float]
    renewals: int
    lost: int

    def us(self, share: float) -> float:
        """Return a percentile in microseconds."""
        return self.reads_s[int(share * (len(self.reads_s) - 1))] * 1e6


def hold(path: str) -> None:
    """Be the holder, until standard input ends; print how often it renewed, and lost the lease."""
    acquire(PRIORITY, ())
    acquiring = {"jsonrpc": "2.0", "id": 1, "method": "lease.acquire", "params": {"ttl_s": TTL_S}}
    renewals = lost = 0
    with Connection(Path(path)) as connection:
        connection.send(json.dumps(acquiring).encode() + b"\n")
        connection.message()
        print("on", flush=True)
        next_s = time.monotonic()
        while not select.select([sys.stdin], [], [], max(next_s - time.monotonic(), 0.0))[0]:
            next_s += RENEW_S
            connection.send(RENEW)
            renewals += 1
            if reason_of(connection.message()) == "lease_lost":
                lost += 1
                connection.send(json.dumps(acquiring).encode() + b"\n")
                connection.message()
    print(json.dumps([renewals, lost]))


@contextlib.contextmanager
def attacked(path: Path, attack: Attack | None) -> Iterator[None]:
    """Let the hostile clients do what they do."""
    processes: list[subprocess.Popen[str]] = []
    try:
        for module, arguments in () if attack is None else attack.clients:
            given = [str(path) if one == "SOCKET" else one for one in arguments]
            processes.append(started(module, *given))
        yield
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def started(module: str, *arguments: str) -> "subprocess.Popen[str]":
    """Start a client that says "on" once it is."""
    command = [sys.executable, "-m", module, *arguments]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    if process.stdout is None or process.stdout.readline() != "on\n":
        raise RuntimeError("a client has ended; it says above why")
    return process


def measure(path: Path, attack: Attack | None, seconds: float) -> Row:
    """Read and renew beside an attack."""
    reads_s: list[float] = []
    with Connection(path) as reader:
        holder = started("bench.hostile.neighbours", "--hold", str(path))
        try:
            with attacked(path, attack):
                ends_s = time.monotonic() + seconds
                while time.monotonic() < ends_s:
                    asked_s = time.perf_counter()
                    reader.send(STATE_GET)
                    reader.line()
                    reads_s.append(time.perf_counter() - asked_s)
                    time.sleep(random.uniform(0.0, PAUSE_S))
                renewals, lost = json.loads(holder.communicate()[0])
        finally:
            holder.kill()
    return Row(IDLE if attack is None else attack.name, sorted(reads_s), renewals, lost)


def alone(path: Path) -> None:
    """Wait until the daemon is rid of the last attack."""
    with Connection(path) as connection:
        while True:
            connection.send(b'{"jsonrpc":"2.0","id":1,"method":"health"}\n')
            if connection.message()["result"]["rpc"]["clients"] == 1:
                return
            time.sleep(0.05)


def table(rows: Sequence[Row]) -> str:
    """Return the table as Markdown."""
    idle = Row(IDLE, sorted(rows[0].reads_s + rows[-1].reads_s), 0, 0)
    lines = [
        "| beside it | read, median | x | 99th percentile | x | leases of 0.1 s lost |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        cells = [
            f"{row.us(share):.0f} µs | {row.us(share) / idle.us(share):.1f}"
            for share in (0.5, 0.99)
        ]
        lines.append(f"| {row.name} | {' | '.join(cells)} | {row.lost} of {row.renewals} |")
    return "\n".join(lines)


def main() -> None:
    if sys.argv[1:2] == ["--hold"]:
        hold(sys.argv[2])
        return
    if os.getuid() != 0:
        sys.exit("only root can become other users")
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
    refused = acquire(PRIORITY, ()).refused
    print("".join(f"not granted: {right}\n" for right in refused), end="")
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        folder.chmod(0o755)  # for other users, as is the socket
        path = folder / "bench.sock"
        arguments = ("bench", "--simulate", "--socket", path)
        daemon = run_module("litegripd.app.main", *arguments)
        stack.callback(daemon.wait)
        stack.callback(daemon.terminate)
        wait_for(path)
        path.chmod(0o666)
        rows = []
        for attack in (None, *ATTACKS, None):
            alone(path)
            rows.append(measure(path, attack, seconds))
    print(table(rows))


if __name__ == "__main__":
    main()
