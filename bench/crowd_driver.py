"""Lets a crowd of processes loose on one daemon, stops, kills and replaces them, and looks after.

It judges by what the daemon tells, never by what a client says; a client that ends by itself has
met a defect, its own or the daemon's.
"""

import contextlib
import heapq
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.crowd_audit import Audit, Death, Loss
from bench.crowd_watcher import Watcher
from litegrip_client.connection import Connection
from litegrip_client.errors import HardwareError

FOLDER = Path(__file__).resolve().parent.parent
DEEDS_A_SECOND = 5.0
LOOK_S = 0.02
KILLED = 0.65  # of the deeds; the others only stop a process for a while
AIMED = 0.75  # of the deeds: at whoever has the lease or moves
LONGEST_STOP_S = 3.0
LONGEST_ABSENCE_S = 1.0
SETTLED_WITHIN_S = 20.0
MOTION_WITHIN_S = 15.0
SPEED_MM_S = 120.0


@dataclass(slots=True)
class Outcome:
    """What became of a daemon among a crowd; `complaints` is empty where all is well.

    Memory is that of the daemon, in MB, once a second, with the seconds since the begin.
    """

    seconds: float
    audit: Audit
    losses: list[Loss]
    deaths: int
    stops: int
    complaints: list[str]
    dropped_samples: int
    health: dict[str, Any]
    descriptors: tuple[int, int]
    memory: list[tuple[float, float]] = field(default_factory=list)


class Crowd:
    """The processes; `deaths` and `stops` are what was done to them."""

    def __init__(self, path: Path, watcher: Watcher, seed: int, errors: Path) -> None:
        self.deaths: list[Death] = []
        self.stops = 0
        self.complaints: list[str] = []
        self._path = path
        self._watcher = watcher
        self._random = random.Random(seed)
        self._errors = errors
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._stopped: set[int] = set()
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._last = 0

    def come(self) -> None:
        """Start one more process."""
        seed = str(self._random.getrandbits(32))
        # Without site-packages, which the client does not need, it starts in half the time.
        command = [sys.executable, "-SE", "-m", "bench.crowd_client", str(self._path), seed]
        with self._errors.open("ab") as file:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, cwd=FOLDER
            )
        self._processes[process.pid] = process

    def arrive(self, count: int) -> None:
        """Start so many, and wait until the daemon has met each; raises `RuntimeError`."""
        for _ in range(count):
            self.come()
        ends_s, missing = time.monotonic() + SETTLED_WITHIN_S + count, set(self._processes)
        with Connection(str(self._path)) as connection:
            while missing:
                missing -= {one["pid"] for one in connection.call("clients.list")["clients"]}
                self._watcher.pass_by(time.monotonic() + LOOK_S)
                self._look_for_dead()
                if time.monotonic() > ends_s:
                    raise RuntimeError(f"{len(missing)} clients did not come; {self.complaints}")

    def act_until(self, ends_s: float) -> None:
        """Stop and kill at random until then."""
        while (now_s := time.monotonic()) < ends_s:
            pause_s = self._random.expovariate(DEEDS_A_SECOND)
            due_s = self._due[0][0] if self._due else ends_s
            self._watcher.pass_by(min(now_s + pause_s, due_s, ends_s))
            if self._due and time.monotonic() >= self._due[0][0]:
                heapq.heappop(self._due)[2]()
            else:
                self._strike()
            self._look_for_dead()

    def end(self) -> None:
        """Kill all of them at once."""
        for pid in list(self._processes):
            self._kill(pid)
        self._due.clear()

    def _strike(self) -> None:
        aims = [pid for pid in self._watcher.in_charge() if pid in self._processes]
        aimed = bool(aims) and self._random.random() < AIMED
        pid = self._random.choice(aims if aimed else list(self._processes))
        if self._random.random() < KILLED:
            self._kill(pid)
            self._later(LONGEST_ABSENCE_S, self.come)
        elif pid not in self._stopped:
            os.kill(pid, signal.SIGSTOP)
            self.stops += 1
            self._stopped.add(pid)
            self._later(LONGEST_STOP_S, lambda: self._go_on(pid))

    def _kill(self, pid: int) -> None:
        process = self._processes.pop(pid)
        self._stopped.discard(pid)
        if process.poll() is not None:
            self._note_end(process)
            return
        at_s = time.monotonic()
        process.kill()
        process.wait()
        self.deaths.append(Death(pid, at_s, time.monotonic()))

    def _go_on(self, pid: int) -> None:
        if pid in self._stopped:
            self._stopped.discard(pid)
            os.kill(pid, signal.SIGCONT)

    def _later(self, within_s: float, deed: Callable[[], None]) -> None:
        self._last += 1
        due_s = time.monotonic() + self._random.uniform(0.05, within_s)
        heapq.heappush(self._due, (due_s, self._last, deed))

    def _look_for_dead(self) -> None:
        ended = [pid for pid, process in self._processes.items() if process.poll() is not None]
        for pid in ended:
            self._note_end(self._processes.pop(pid))
            self.come()

    def _note_end(self, process: "subprocess.Popen[bytes]") -> None:
        text = self._errors.read_text(encoding="utf-8")[-2000:]
        self.complaints.append(f"a client ended by itself ({process.returncode}): {text}")


def survive(path: Path, daemon: int, clients: int, seconds: float, seed: int) -> Outcome:
    """Let a crowd use the daemon at `path`, of pid `daemon`, and return what became of it."""
    with contextlib.closing(Watcher(path)) as watcher:
        complaints: list[str] = []
        before = _descriptors_alone(path, daemon, complaints)
        crowd = Crowd(path, watcher, seed, path.parent / "clients.txt")
        memory = [(0.0, _resident_mb(daemon))]
        try:
            crowd.arrive(clients)
            began_s = time.monotonic()
            while (passed_s := time.monotonic() - began_s) < seconds:
                crowd.act_until(began_s + min(passed_s + 1.0, seconds))
                memory.append((time.monotonic() - began_s, _resident_mb(daemon)))
        finally:
            crowd.end()
        after = _descriptors_alone(path, daemon, complaints)
        memory.append((time.monotonic() - began_s, _resident_mb(daemon)))
        _use(path)
        health = _health(path)
        if not watcher.is_alive():
            complaints.append("the daemon has closed the watcher's connection")
    losses = watcher.audit.judge(watcher.samples, crowd.deaths)
    complaints += crowd.complaints + watcher.audit.complaints + _defects(health)
    if before != after:
        complaints.append(f"the daemon had {before} descriptors before the crowd, {after} after")
    return Outcome(
        seconds=seconds,
        audit=watcher.audit,
        losses=losses,
        deaths=len(crowd.deaths),
        stops=crowd.stops,
        complaints=complaints,
        dropped_samples=watcher.dropped,
        health=health,
        descriptors=(before, after),
        memory=memory,
    )


def _use(path: Path) -> None:
    """Enable, open and close, as a client that has just come; raises what goes wrong.

    A machine that stalls may make the motor fault or fall silent: then once more.
    """
    ends_s = time.monotonic() + SETTLED_WITHIN_S
    with Connection(str(path)) as connection:
        while not _moves(connection, give_up=time.monotonic() > ends_s):
            pass


def _moves(connection: Connection, *, give_up: bool) -> bool:
    try:
        connection.call("stop.clear")
        speed = {"speed_mm_s": SPEED_MM_S}
        for method, params in (
            ("motor.enable", {}),
            ("motion.open", speed),
            ("motion.close", speed),
        ):
            result = connection.call(method, params, timeout_s=MOTION_WITHIN_S)
            if not result["ok"]:
                raise RuntimeError(f"{method} failed: {result}")
    except HardwareError:
        if give_up:
            raise
        return False
    return True


def _descriptors_alone(path: Path, daemon: int, complaints: list[str]) -> int:
    """Wait until all but the watcher have left and nothing moves; count the daemon's descriptors.

    They are counted while the connection is open that asks: it would be gone at some time.
    """
    ends_s = time.monotonic() + SETTLED_WITHIN_S
    with Connection(str(path)) as connection:
        while True:
            clients = len(connection.call("clients.list")["clients"])
            job, lease = connection.call("state.get")["job"], connection.call("lease.get")
            is_free = job is None and lease["owner"] is None and not lease["waiting"]
            if clients == 2 and is_free:
                break
            if time.monotonic() > ends_s:
                what = f"all have left, but: {clients} clients, job {job}, lease {lease}"
                complaints.append(what)
                break
        return sum(1 for _ in Path(f"/proc/{daemon}/fd").iterdir())


def _health(path: Path) -> dict[str, Any]:
    with Connection(str(path)) as connection:
        return connection.call("health")


def _defects(health: dict[str, Any]) -> list[str]:
    found = [f"health: {reason}" for reason in health["reasons"] if "by a defect" in reason]
    if health["control"]["tick_errors"]:
        found.append(f"health: {health['control']['tick_errors']} tick errors")
    if health["helper"]["deaths"]:
        found.append(f"health: the helper has died: {health['helper']}")
    return found


def _resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGESIZE") / 1e6
