"""Daemons with simulated grippers that teleoperate, and a network between them that fails."""

import contextlib
import heapq
import os
import random
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.process.daemon_process import DEADLINE_S, SIMULATED, Client, DaemonProcess

CONFIG = SIMULATED.replace('"normal"', '"{mount}"')
"""The configuration of one: `format` takes the mount."""

HAND = ("-m", "bench.teleop.handheld", "2.5", "20", "65")
"""A hand that moves the jaws by 45 mm and back in 2.5 s: 57 mm/s at most."""


def start(
    folder: Path, name: str, mount: str = "normal", *, by_hand: bool = False
) -> DaemonProcess:
    """Start a daemon whose motor's watchdog is as slow as motors have it."""
    folder.mkdir(exist_ok=True)
    config = folder / "gripper.toml"
    config.write_text(CONFIG.format(mount=mount), encoding="utf-8")
    arguments = (f"{name}-{os.getpid()}", "--config", str(config))
    program = HAND if by_hand else ("-m", "litegripd.app.main")
    return DaemonProcess(folder, *arguments, "--socket", str(folder / "rpc.sock"), program=program)


@contextlib.contextmanager
def gripper(
    folder: Path, name: str, mount: str = "normal", *, by_hand: bool = False
) -> Iterator[DaemonProcess]:
    """Run such a daemon; it must still be well at the end."""
    running = start(folder, name, mount, by_hand=by_hand)
    try:
        yield running
        running.end()
    finally:
        running.kill()


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(client: Client, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Watch teleoperation until a condition holds; return that status."""
    ends_s = time.monotonic() + DEADLINE_S
    while True:
        status = client.result("teleop.status")
        if condition(status):
            return status
        assert time.monotonic() < ends_s, f"did not happen in time: {status}"


def children(pid: int) -> dict[str, int]:
    """Return the processes that a daemon has had started, by the modules that they run."""
    found: dict[str, int] = {}
    for path in Path(f"/proc/{pid}/task").iterdir():
        for child in (path / "children").read_text(encoding="ascii").split():
            command = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            found[command[2].decode() if len(command) > 2 else "?"] = int(child)
            found |= children(int(child))
    return found


def network_sockets(pid: int) -> set[tuple[str, int, str]]:
    """Return the protocol, the own port and the state of a process's sockets of the network."""
    links = (str(path.readlink()) for path in Path(f"/proc/{pid}/fd").iterdir())
    own = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    found = set()
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        table = Path(f"/proc/{pid}/net/{protocol}").read_text(encoding="ascii").splitlines()[1:]
        for row in map(str.split, table):
            if row[9] in own:
                found.add((protocol, int(row[1].rpartition(":")[2], 16), STATES.get(row[3], "?")))
    return found


STATES = {"01": "connected", "0A": "listens"}


class LossyProxy:
    """Passes datagrams on from one port to another: some not, the others late and out of order.

    While `is_cut`, none. `loss` and `jitter_s` may be changed at any time; of `every` datagrams
    that come one is looked at.
    """

    def __init__(
        self, to_port: int, loss: float, jitter_s: float, seed: int, every: int = 1
    ) -> None:
        self.is_cut = False
        self.passed = 0
        self.lost = 0
        self._to = ("127.0.0.1", to_port)
        self.loss, self.jitter_s = loss, jitter_s
        self._every = every
        self._random = random.Random(seed)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.bind(("127.0.0.1", 0))
        self.port = int(self._in.getsockname()[1])
        self._waiting: list[tuple[float, int, bytes]] = []
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "LossyProxy":
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._ends.set()
        self._thread.join()
        self._in.close()

    def _run(self) -> None:
        count = 0
        while not self._ends.is_set():
            if select.select([self._in], [], [], 0.002)[0]:
                count += 1
                payload = self._in.recv(2048)
                if count % self._every:
                    continue
                if self.is_cut or self._random.random() < self.loss:
                    self.lost += 1
                else:
                    due_s = time.monotonic() + self._random.random() * self.jitter_s
                    heapq.heappush(self._waiting, (due_s, count, payload))
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                self._in.sendto(heapq.heappop(self._waiting)[2], self._to)
                self.passed += 1


class Samples:
    """Takes every state of a daemon, until the end of the block."""

    FIELDS = ("monotonic_s", "position_rad", "requested_rad", "openness", "feedback_s", "torque_nm")

    def __init__(self, running: DaemonProcess) -> None:
        self.rows: list[list[float]] = []
        self._client = running.connect()
        self._thread = threading.Thread(target=self._read)

    def __enter__(self) -> "Samples":
        fields = list(self.FIELDS)
        self._client.result("state.subscribe", hz=200, fields=fields, batch=20)
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._client.socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._client.close()

    def _read(self) -> None:
        while message := self._client.read():
            self.rows += message["params"]["rows"]
