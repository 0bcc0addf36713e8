"""How many instructions one read of the state takes the daemon's core, and servers written by hand.

python -m bench.timing.instructions [ROUNDS, default 100]

Instructions are counted by valgrind in the user's space, so that nothing else on the machine
matters; the start is not counted. In a round, every client asks once, and all are answered: one
client, and 60, which are ready together. The core is the reactor, the server and the service, whose
next tick is far away; all answer with the same state.
"""

import contextlib
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.__main__ import wait_for
from bench.timing.client import REQUEST
from bench.timing.rivals import serve_asyncio, serve_epoll
from litegripd.io.loop import Reactor
from litegripd.io.server import Server
from litegripd.io.sockets import listen
from tests.world import World

CLIENTS = (1, 60)
WARM_ROUNDS = 20
START_WITHIN_S = 200.0  # valgrind takes its time
PERIOD_S = 10.0


def serve_core(path: Path) -> None:
    """Answer by the daemon's own core, for a gripper that stands still."""
    world = World()
    world.run(0.1)
    reactor = Reactor(PERIOD_S, lambda _now_s: None)
    reactor.backlog = Server(reactor, listen(path, None), world.service)
    reactor.run()


SERVERS = ("litegripd", "an epoll loop and JSON", "asyncio's streams and JSON")


def serve(name: str, path: Path) -> None:
    """Answer at a socket until this process is ended."""
    state = json.loads((path.parent / "state.json").read_text(encoding="utf-8"))
    if name == SERVERS[0]:
        serve_core(path)
    elif name == SERVERS[1]:
        serve_epoll(path, state)
    else:
        serve_asyncio(path, state)


def ask(opened: list[socket.socket], rounds: int) -> None:
    """Have every client ask in each round, then read all answers."""
    for _ in range(rounds):
        for one in opened:
            one.sendall(REQUEST)
        for one in opened:
            received = one.recv(65536)
            while not received.endswith(b"\n"):
                received += one.recv(65536)


def instructions(folder: Path, name: str, clients: int, rounds: int) -> float:
    """Return how many instructions a server takes for a request."""
    path = folder / "bench.sock"
    command = ["valgrind", "--tool=callgrind", "--instr-atstart=no"]
    command += [f"--callgrind-out-file={folder / 'callgrind.out'}", sys.executable]
    server = subprocess.Popen(
        [*command, "-m", "bench.timing.instructions", "--serve", name, str(path)],
        env={**os.environ, "PYTHONHASHSEED": "0"},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        wait_for(path, START_WITHIN_S)
        with contextlib.ExitStack() as stack:
            opened = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(clients)]
            for one in opened:
                one.connect(str(path))
            ask(opened, WARM_ROUNDS)
            counting = ["callgrind_control", "-i", "on", str(server.pid)]
            subprocess.run(counting, check=True, capture_output=True)
            ask(opened, rounds)
            server.terminate()
            said = server.communicate()[1]
    finally:
        server.kill()
        path.unlink(missing_ok=True)
    found = re.search(r"Collected : (\d+)", said)
    if found is None:
        raise RuntimeError(said)
    return int(found[1]) / (rounds * clients)


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["--serve"]:
        serve(sys.argv[2], Path(sys.argv[3]))
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    world = World()
    world.run(0.1)
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        folder.joinpath("state.json").write_bytes(world.service.reporter.state_line())
        for clients in CLIENTS:
            more = rounds * (CLIENTS[-1] if clients == 1 else 1)
            taken = {name: instructions(folder, name, clients, more) for name in SERVERS}
            for name, own in taken.items():
                ratios = ", ".join(f"{own / taken[of]:5.2f} x {of}" for of in SERVERS[1:])
                print(f"{clients:3d} clients {own / 1e3:7.1f} thousand, {ratios}: {name}")


if __name__ == "__main__":
    main()
