"""True if a daemon survives a crowd: what it tells meanwhile, and how it is when all have left.

It judges by what the daemon tells and by what the kernel knows of it, never by what a client says.
"""

import contextlib
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.crowd.audit import Audit, Loss
from bench.crowd.driver import Crowd
from bench.crowd.watcher import Watcher
from litegrip_client.line.connection import Connection
from litegrip_client.values.errors import HardwareError, LiteGripError

SETTLED_WITHIN_S = 20.0
MOTION_WITHIN_S = 15.0
SPEED_MM_S = 120.0
UNENDED = ("queued", "running")


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
        complaints += _useless(path)
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


def _useless(path: Path) -> list[str]:
    """Enable, open and close, as a client that has just come; tell what goes wrong.

    A machine that stalls may make the motor fault or fall silent: then once more.
    """
    ends_s = time.monotonic() + SETTLED_WITHIN_S
    try:
        with Connection(str(path)) as connection:
            while not _moves(connection, give_up=time.monotonic() > ends_s):
                pass
    except LiteGripError as error:
        return [f"a client that comes after the crowd: {error}"]
    return []


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
            jobs = [job for job in connection.call("job.list")["jobs"] if job["state"] in UNENDED]
            lease = connection.call("lease.get")
            is_free = lease["owner"] is None and not lease["waiting"]
            if clients == 2 and not jobs and is_free:
                break
            if time.monotonic() > ends_s:
                what = f"all have left, but: {clients} clients, jobs {jobs}, lease {lease}"
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
