"""Lets a crowd of processes loose on one daemon; stops, kills and replaces them at random.

It judges nothing but this: a client that ends by itself has met a defect, its own or the daemon's.
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
from pathlib import Path

from bench.crowd.audit import Death
from bench.crowd.watcher import Watcher
from litegrip_client.line.connection import Connection

FOLDER = Path(__file__).resolve().parents[2]
PRIORITY = 40
"""Below the daemon's, above all that is ordinary: so a killed process gets a processor to end on.
Before it has ended its files are open, and the daemon cannot know."""

DEEDS_A_SECOND = 5.0
LOOK_S = 0.02
KILLED = 0.65  # of the deeds; the others only stop a process for a while
AIMED = 0.75  # of the deeds: at whoever has the lease or moves
LONGEST_STOP_S = 3.0
LONGEST_ABSENCE_S = 1.0
ARRIVED_WITHIN_S = 60.0


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
        command = [sys.executable, "-SE", "-m", "bench.crowd.client", str(self._path), seed]
        with self._errors.open("ab") as file:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, cwd=FOLDER
            )
        self._processes[process.pid] = process

    def arrive(self, count: int) -> None:
        """Start so many, and wait until the daemon has met each; raises `RuntimeError`."""
        for _ in range(count):
            self.come()
        ends_s, missing = time.monotonic() + ARRIVED_WITHIN_S, set(self._processes)
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
        with contextlib.suppress(PermissionError):  # then the machine may delay its end
            os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
        at_s = time.monotonic()
        os.kill(pid, signal.SIGKILL)
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
