"""What one read of the state takes, from a bare echo to the clients: alternating, in one process.

python -m bench.timing.reads [ROUNDS, default 60]

The floors are an echo of an answer's size by a process that does nothing else, the exchange of raw
lines with the daemon, the same with `json.loads`, and that by asyncio's own streams. What is
printed is the median of the rounds' medians, and of the rounds' ratios to two of the floors.
"""

import asyncio
import contextlib
import json
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from bench.__main__ import enable, run_module, wait_for
from bench.timing.client import REQUEST
from litegrip_client import LiteGrip, aio

EXCHANGES = 200
"""In a round, by each way, one way after the other."""
Round: TypeAlias = Callable[[], list[float]]


def echo(path: Path, size: int) -> None:
    """Answer everything that comes on a socket with a line of `size` bytes, as fast as it goes."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        line = b"x" * (size - 1) + b"\n"
        while True:
            peer, _ = listener.accept()
            with peer:
                while peer.recv(65536):
                    peer.sendall(line)


def timed(exchange: Callable[[], object]) -> list[float]:
    """Return how long each of a round's exchanges took, in seconds."""
    took = []
    for _ in range(EXCHANGES):
        began_s = time.perf_counter()
        exchange()
        took.append(time.perf_counter() - began_s)
    return took


def raw(path: Path) -> Callable[[], bytes]:
    """Return what exchanges lines with the daemon, or the echo, at a socket."""
    connected = socket.socket(socket.AF_UNIX)
    connected.connect(str(path))

    def exchange() -> bytes:
        connected.sendall(REQUEST)
        received = connected.recv(65536)
        while not received.endswith(b"\n"):
            received += connected.recv(65536)
        return received

    return exchange


class Tasks:
    """The two ways of asyncio, in an event loop of their own."""

    def __init__(self, path: Path) -> None:
        self.loop = asyncio.new_event_loop()
        self.gripper = aio.LiteGrip("bench", socket_path=str(path))
        self.loop.run_until_complete(self.gripper.connect())
        opening = asyncio.open_unix_connection(str(path))
        self.reader, self.writer = self.loop.run_until_complete(opening)

    def streams(self) -> list[float]:
        """Time asyncio's streams with `json.loads`."""
        return self.loop.run_until_complete(self._streams())

    def client(self) -> list[float]:
        """Time the client for asyncio."""
        return self.loop.run_until_complete(self._client())

    async def _streams(self) -> list[float]:
        took = []
        for _ in range(EXCHANGES):
            began_s = time.perf_counter()
            self.writer.write(REQUEST)
            json.loads(await self.reader.readline())
            took.append(time.perf_counter() - began_s)
        return took

    async def _client(self) -> list[float]:
        took = []
        for _ in range(EXCHANGES):
            began_s = time.perf_counter()
            await self.gripper.get_state()
            took.append(time.perf_counter() - began_s)
        return took


def ways(folder: Path, stack: contextlib.ExitStack) -> dict[str, Round]:
    """Start the daemon and the echo; return what does a round by each way."""
    path, echo_path = folder / "bench.sock", folder / "echo.sock"
    daemon = run_module("litegripd.app.main", "bench", "--simulate", "--socket", path)
    stack.callback(daemon.kill)
    wait_for(path)
    enable(path)
    answer = raw(path)
    size = statistics.mode(len(answer()) for _ in range(EXCHANGES))
    echo = run_module("bench.timing.reads", "--echo", echo_path, size)
    stack.callback(echo.kill)
    wait_for(echo_path)
    echoed = raw(echo_path)
    gripper = LiteGrip("bench", socket_path=str(path))
    gripper.connect()
    tasks = Tasks(path)
    return {
        "an echo": lambda: timed(echoed),
        "raw lines": lambda: timed(answer),
        "raw lines and json.loads": lambda: timed(lambda: json.loads(answer())),
        "LiteGrip.get_state()": lambda: timed(gripper.get_state),
        "asyncio's streams and json.loads": tasks.streams,
        "aio.LiteGrip.get_state()": tasks.client,
    }


def main() -> None:
    if sys.argv[1:2] == ["--echo"]:
        echo(Path(sys.argv[2]), int(sys.argv[3]))
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        kinds = ways(Path(name), stack)
        seen: dict[str, list[float]] = {what: [] for what in kinds}
        for _ in range(rounds):
            for what, run in kinds.items():
                seen[what].append(statistics.median(run()))
    print(f"{rounds} rounds of {EXCHANGES} exchanges; µs, and times a floor, round by round")
    floors = ("raw lines", "raw lines and json.loads")
    for what, medians in seen.items():
        ratios = (
            statistics.median(one / floor for one, floor in zip(medians, seen[of], strict=True))
            for of in floors
        )
        cells = ", ".join(f"{ratio:5.2f} x {of}" for ratio, of in zip(ratios, floors, strict=True))
        print(f"{statistics.median(medians) * 1e6:7.1f}  {what:<34}{cells}")


if __name__ == "__main__":
    main()
