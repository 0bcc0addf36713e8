"""Hostile clients over a real socket: who behaves well is served, and nothing is left of them."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.hostile.polite import Polite
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, daemon_for_all, line_of

pytestmark = pytest.mark.alone

READS, MOTIONS = 200, 1
TURNED_AWAY = 1000
UIDS = ("30001", "30002", "30003", "30004") if os.getuid() == 0 else ()
MAX_CONNECTIONS, MAX_PER_UID = 256, 64


@pytest.fixture(scope="module")
def running() -> Iterator[DaemonProcess]:
    """One daemon for all, so that what one kind leaves behind meets the next one."""
    with daemon_for_all(f"hostile-{os.getpid()}") as process:
        yield process


class HostileProcess:
    """A hostile client of some kind that has begun."""

    def __init__(self, kind: str, path: Path, *uid: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "bench.hostile.clients", kind, str(path), *uid],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def wait_until_on(self) -> None:
        assert line_of(self._process) == "on"

    def figures(self) -> dict[str, int]:
        """Let it end; return what it counted."""
        output, _ = self._process.communicate(timeout=DEADLINE_S)
        assert self._process.returncode == 0, "it says above which promise was broken"
        figures: dict[str, int] = json.loads(output)
        return figures

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


@contextlib.contextmanager
def beside(
    running: DaemonProcess, *kinds: tuple[str, ...]
) -> Iterator[tuple[Polite, list[HostileProcess]]]:
    """Let a polite client work beside hostile ones; afterwards the daemon must be as before."""
    with Polite(running.socket_path) as polite, contextlib.ExitStack() as stack:
        before = polite.until(
            "health", lambda h: bool(h["rpc"]["clients"] == 1 and h["helper"]["pid"])
        )
        descriptors = descriptors_of(running)
        hostile = [HostileProcess(kind, running.socket_path, *uid) for kind, *uid in kinds]
        for one in hostile:
            stack.callback(one.kill)
        for one in hostile:
            one.wait_until_on()
        work(polite)
        yield polite, hostile
        for one in hostile:
            one.kill()
        motions = polite.motions
        health = polite.until("health", lambda h: bool(h["rpc"]["clients"] == 1))
        polite.until("health", lambda _: descriptors_of(running) == descriptors)
        assert health["control"]["tick_errors"] == 0
        assert not [reason for reason in health["reasons"] if "defect" in reason]
        for figure in ("pid", "deaths"):  # it may have refused what was too much for it
            assert health["helper"][figure] == before["helper"][figure]
        assert health["motor"]["commands"] > before["motor"]["commands"]
        polite.work(lambda: polite.motions > motions)
    assert "Traceback" not in running.log


def descriptors_of(running: DaemonProcess) -> int:
    return len(list(Path(f"/proc/{running.process.pid}/fd").iterdir()))


def work(polite: Polite) -> None:
    """Let a polite client read and move a little; it checks every answer."""
    reads, motions = len(polite.latencies_s) + READS, polite.motions + MOTIONS
    polite.work(lambda: len(polite.latencies_s) >= reads and polite.motions >= motions)


def test_hostile_lines_are_each_answered(running: DaemonProcess) -> None:
    with beside(running, ("fuzzer",)) as (_, (fuzzer,)):
        figures = fuzzer.figures()
    assert figures["lines"] >= 350 * figures["connections"] > 0
    assert figures["refused"] > figures["lines"] / 2


@pytest.mark.parametrize("kind", ["flooder", "deaf flooder", "half open"])
def test_who_floods_or_never_reads_or_stops_half_way_keeps_nobody_out(
    running: DaemonProcess, kind: str
) -> None:
    with beside(running, (kind,), (kind,)) as (_, hostile):
        for one in hostile:
            assert max(one.figures().values()) > 0


def test_who_subscribes_and_never_reads_loses_its_own_samples_alone(
    running: DaemonProcess,
) -> None:
    with beside(running, ("deaf subscriber",)) as (polite, (deaf,)):
        clients = polite.until("clients.list", lambda told: lost_samples(told) == 8)["clients"]
        (me,) = [client for client in clients if client["is_me"]]
        assert me["requests"] > READS
        figures = deaf.figures()
        assert figures.get("still there", 0) + figures.get("closed", 0) == 8


def lost_samples(told: dict[str, Any]) -> int:
    """Count the clients that were not sent what they had subscribed to."""
    return sum(client["dropped"] > 0 for client in told["clients"])


def test_connections_without_end_are_refused_and_the_first_ones_stay(
    running: DaemonProcess,
) -> None:
    crowds: list[tuple[str, ...]] = [("crowd", uid) for uid in UIDS] or [("crowd",)]
    limit = MAX_CONNECTIONS if UIDS else MAX_PER_UID
    with beside(running, *crowds) as (polite, hostile):
        polite.until("health", lambda health: bool(health["rpc"]["clients"] == limit))
        before = polite.result("health")["rpc"]["refused_connections"]
        polite.until(
            "health", lambda h: bool(h["rpc"]["refused_connections"] >= before + TURNED_AWAY)
        )
        work(polite)
        for one in hostile:
            assert one.figures()["turned away"] >= 250


def test_all_of_them_at_once(running: DaemonProcess) -> None:
    crowd = ("crowd", *UIDS[:1])
    kinds: list[tuple[str, ...]] = [
        (k,) for k in ("fuzzer", "flooder", "deaf flooder", "deaf subscriber", "half open")
    ]
    if UIDS:  # else the crowd would leave no place for those that come later
        kinds.append(crowd)
    with beside(running, *kinds) as (_, hostile):
        for one in hostile:
            assert max(one.figures().values()) > 0
