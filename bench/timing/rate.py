"""How fast one and 60 clients are answered, by the daemon and by servers that are written by hand.

python -m bench.timing.rate [ROUNDS, default 30]

Each client asks for the state once, all at a time, and all answers are read; then the same again.
The servers take turns. What is printed is the median of the rounds: the time of one request, the
processor's time that the server took for it, and both as times those of the epoll loop. The daemon
has its 200 ticks a second beside the requests, and answers in at most half of the time.
"""

import contextlib
import json
import socket
import statistics
import sys
import tempfile
import time
from pathlib import Path

from bench.__main__ import call, enable, run_module, wait_for
from bench.timing.instructions import SERVERS, ask

REQUESTS = 1200
"""In a round, to each server."""
CLIENTS = (1, 60)
DAEMON, EPOLL, _ = SERVERS


def processor_s(pid: int) -> float:
    """Return the processor's time that a process of one thread has taken."""
    return int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[0]) / 1e9


def start(folder: Path, stack: contextlib.ExitStack) -> dict[str, tuple[int, Path]]:
    """Start the daemon, and the servers with its state; return their processes and sockets."""
    started = {}
    for number, name in enumerate(SERVERS):
        path = folder / f"{number}.sock"
        words: tuple[object, ...] = ("bench.timing.instructions", "--serve", name, path)
        if name == DAEMON:
            words = ("litegripd.app.main", "bench", "--simulate", "--socket", path)
        server = run_module(*map(str, words))
        stack.callback(server.kill)
        wait_for(path)
        if name == DAEMON:
            enable(path)
            state = call(path, "state.get")["result"]
            folder.joinpath("state.json").write_text(json.dumps(state), encoding="utf-8")
        started[name] = (server.pid, path)
    return started


def measure(rounds: int, clients: int) -> dict[str, list[tuple[float, float]]]:
    """Return by server what a request took in each round: time, and processor's time."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        servers = start(Path(name), stack)
        opened: dict[str, list[socket.socket]] = {}
        for server, (_pid, path) in servers.items():
            opened[server] = [
                stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(clients)
            ]
            for one in opened[server]:
                one.connect(str(path))
        seen: dict[str, list[tuple[float, float]]] = {server: [] for server in servers}
        times = REQUESTS // clients
        for _ in range(rounds):
            for server, (pid, _path) in servers.items():
                used_s, began_s = processor_s(pid), time.perf_counter()
                ask(opened[server], times)
                took_s = time.perf_counter() - began_s
                each = 1e6 / (times * clients)
                seen[server].append((took_s * each, (processor_s(pid) - used_s) * each))
        return seen


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    for clients in CLIENTS:
        seen = measure(rounds, clients)
        for server, rows in seen.items():
            cells = []
            for own, of in zip(
                zip(*rows, strict=True), zip(*seen[EPOLL], strict=True), strict=True
            ):
                ratio = statistics.median(one / other for one, other in zip(own, of, strict=True))
                cells.append(f"{statistics.median(own):6.1f} µs {ratio:5.2f} x")
            print(f"{clients:3d} clients: {cells[0]}, processor {cells[1]}: {server}")


if __name__ == "__main__":
    main()
