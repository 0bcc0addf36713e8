"""From the `send` of a stop to the first CAN frame that stops, beside clients that flood.

python -m bench.timing.stop [STOPS per case, default 200]

The daemon is a process of its own, and the bus of its simulated gripper notes there when each
command frame is handed to it (CLOCK_MONOTONIC, which all processes share); the notes are read when
the daemon has ended. Stops are sent at random times within a period while the jaws move, when
every command frame differs from the one before; a hold repeats one and the same. The latency is
that from just before `send` to the first of those equal frames. `late` counts the stops after
which a tick still moved that had begun later: its frame came over 1 ms after `send` had returned.
How punctual the machine itself is, tells `machine`.
"""

import contextlib
import itertools
import json
import random
import signal
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from bench.__main__ import enable, output_of, run_module, wait_for
from litegripd.app.main import main as run_daemon
from litegripd.io.realtime import acquire
from litegripd.sim import interface

PERIOD_S = 0.005
LIMIT_S = PERIOD_S + 1e-3
TICK_NS = 1_000_000  # so long at most a tick takes until its frame is handed over
CAN_ID = 0x08
PRIORITY = 51  # the sender's, so that the machine is measured as little as possible
FLOODING_CLIENTS = 8
REQUEST = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\n'
CONFIG = '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n'
_NOTE = struct.Struct("<q8s")


class NotedBus(interface.SimulatedBus):
    """A simulated bus that notes the command frames which the daemon sends."""

    notes: list[tuple[int, bytes]] = []  # noqa: RUF012 - there is one bus
    file = Path()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if msg.arbitration_id == CAN_ID:
            self.notes.append((time.monotonic_ns(), bytes(msg.data)))
        super().send(msg, timeout)

    def shutdown(self) -> None:
        super().shutdown()
        self.file.write_bytes(b"".join(itertools.starmap(_NOTE.pack, self.notes)))


class Client:
    """One connection to the daemon."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(path))
        self._lines = self.socket.makefile("rb")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        request = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        return self.answer()

    def answer(self) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self._lines.readline())
        return answer

    def result(self, method: str, **params: Any) -> dict[str, Any]:
        answer = self.call(method, **params)
        if "result" not in answer:
            raise RuntimeError(f"{method}: {answer}")
        result: dict[str, Any] = answer["result"]
        return result

    def close(self) -> None:
        self._lines.close()
        self.socket.close()


@dataclass(frozen=True, slots=True)
class Sent:
    """One stop: when its `send` began and ended, and until when it was in force, nanoseconds."""

    began_ns: int
    ended_ns: int
    until_ns: int


def daemon(notes: str, *arguments: str) -> int:
    """Be the daemon, with a bus that notes what it is given."""
    NotedBus.file = Path(notes)
    interface.SimulatedBus = NotedBus  # type: ignore[misc]
    return run_daemon(arguments)


def flood(path: str) -> None:
    """Ask for the state as often as the daemon answers, a hundred at once, until killed."""
    begun = False
    with socket.socket(socket.AF_UNIX) as connected:
        connected.connect(path)
        while True:
            connected.sendall(REQUEST * 100)
            answers = 0
            while answers < 100:
                answers += connected.recv(1 << 20).count(b"\n")
            if not begun:
                begun = True
                print("begun", flush=True)


@contextlib.contextmanager
def flooding(path: Path, count: int) -> Iterator[None]:
    """Let so many processes flood the daemon's other socket."""
    processes = [run_module("bench.timing.stop", "--flood", path) for _ in range(count)]
    try:
        for process in processes:
            if process.stdout is None or process.stdout.readline() != "begun\n":
                raise RuntimeError("a client that floods has ended")
        yield
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def stop_while_moving(client: Client, stopper: Client) -> Sent:
    """Let the jaws move, stop them at some time within a period, and let them go on later."""
    openness = client.result("state.get")["openness"]
    client.result("motion.move", openness=float(openness < 0.5), speed_mm_s=40, wait=False)
    time.sleep(0.1 + random.uniform(0.0, 4 * PERIOD_S))
    request = b'{"jsonrpc":"2.0","id":1,"method":"stop"}\n'
    began_ns = time.monotonic_ns()
    stopper.socket.send(request)
    ended_ns = time.monotonic_ns()
    stopper.answer()
    time.sleep(0.05)
    until_ns = time.monotonic_ns()
    client.result("stop.clear")
    return Sent(began_ns, ended_ns, until_ns)


def latency(sent: Sent, notes: list[tuple[int, bytes]]) -> tuple[float, bool] | None:
    """Return the seconds to the first frame that holds, and whether a later tick did not.

    None where the jaws were not seen moving before: the machine had stalled.
    """
    before = [data for at_ns, data in notes if 0 < sent.began_ns - at_ns < 50_000_000]
    if len(before) < 5 or any(one == other for one, other in itertools.pairwise(before)):
        return None
    after = [note for note in notes if sent.began_ns < note[0] < sent.until_ns]
    first = len(after) - 1
    while first > 0 and after[first - 1][1] == after[-1][1]:
        first -= 1
    if len(after) - first < 3:
        raise RuntimeError("the jaws were not held when they had been stopped")
    late = any(at_ns > sent.ended_ns + TICK_NS for at_ns, _data in after[:first])
    return (after[first][0] - sent.began_ns) * 1e-9, late


def measure(name: str, count: int, clients: int, by_stop_socket: bool) -> str:
    """Run one case; return its row."""
    with tempfile.TemporaryDirectory() as folder_name, contextlib.ExitStack() as stack:
        folder = Path(folder_name)
        path, file = folder / "bench.sock", folder / "notes"
        (folder / "config.toml").write_text(CONFIG, encoding="utf-8")
        arguments = ("bench", "--config", folder / "config.toml", "--socket", path)
        process = run_module("bench.timing.stop", "--daemon", file, *arguments)
        stack.callback(process.kill)
        wait_for(path)
        enable(path)
        client = stack.enter_context(contextlib.closing(Client(path)))
        stop_path = folder / "bench.stop.sock" if by_stop_socket else path
        stopper = stack.enter_context(contextlib.closing(Client(stop_path)))
        client.result("motion.close")
        machine = run_module("bench.timing.reference", count * 0.2)
        with flooding(path, clients):
            sent = [stop_while_moving(client, stopper) for _ in range(count)]
        noise = output_of(machine)
        health = client.result("health")
        process.send_signal(signal.SIGTERM)
        process.communicate()
        notes = list(_NOTE.iter_unpack(file.read_bytes()))
    measured = [found for one in sent if (found := latency(one, notes)) is not None]
    if len(measured) < 0.9 * count:
        raise RuntimeError(f"of {count} stops only {len(measured)} met moving jaws")
    ordered = sorted(seconds for seconds, _late in measured)
    lateness = health["control"]["lateness"]
    requests_s = health["rpc"]["requests"] / health["uptime_s"]
    p50, p99, worst = (ordered[int(share * (len(ordered) - 1))] * 1e3 for share in (0.5, 0.99, 1.0))
    over, late = sum(s > LIMIT_S for s in ordered), sum(late for _seconds, late in measured)
    return (
        f"{name:<30}{p50:>7.2f}{p99:>7.2f}{worst:>7.2f}{over:>9}{late:>6}{requests_s:>12.0f}"
        f"   ticks: {lateness['p99_us']:.0f}, {lateness['worst_us']:.0f}"
        f"   machine: {noise['p99_us']:.0f}, {noise['worst_us']:.0f}"
    )


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    refused = acquire(PRIORITY, ()).refused
    print(f"{count} stops a case; ms to the first frame that holds; lateness p99 and worst in µs")
    print("".join(f"the sender was not granted {right}\n" for right in refused), end="")
    over = f"> {LIMIT_S * 1e3:g} ms"
    print(f"{'':<30}{'p50':>7}{'p99':>7}{'worst':>7}{over:>9}{'late':>6}{'requests/s':>12}")
    for name, clients, by_stop_socket in (
        ("stop socket", 0, True),
        ("stop socket, 8 clients flood", FLOODING_CLIENTS, True),
        ("other socket, 8 clients flood", FLOODING_CLIENTS, False),
    ):
        print(measure(name, count, clients, by_stop_socket), flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--daemon"]:
        sys.exit(daemon(*sys.argv[2:]))
    elif sys.argv[1:2] == ["--flood"]:
        flood(sys.argv[2])
    else:
        main()
