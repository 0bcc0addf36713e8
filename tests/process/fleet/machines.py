"""Machines with a network between them, on this one: for tests of the fleet, and their bench.

Each is a network namespace: its own addresses, ports and cable; files, Unix sockets and processes
are shared with this machine. `cable.py` is the network.
"""

import contextlib
import itertools
import json
import os
import select
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from typing import Any

from tests.process.daemon_process import DEADLINE_S
from tests.process.fleet import cable
from tests.process.fleet.cable import SOUND, Fault

_numbers = itertools.count(1)


class Machines:
    """Some machines; whoever made them closes them."""

    def __init__(self, *names: str, seed: int = 1) -> None:
        self.names = names
        self._prefix = f"litegrip-{os.getpid()}-{next(_numbers)}"
        self._process = subprocess.Popen(
            [sys.executable, cable.__file__, self._prefix, str(seed), *names],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            self.addresses: dict[str, str] = self._answer()["addresses"]
        except BaseException:
            self.close()
            raise

    def namespace(self, name: str) -> str:
        """Return the name of a machine's namespace."""
        return f"{self._prefix}-{name}"

    def on(self, name: str) -> tuple[str, ...]:
        """Return what makes a command run on a machine; put it in front.

        The command's process is that of `ip`, which becomes it: it can be sent signals.
        """
        return "ip", "netns", "exec", self.namespace(name)

    def socket(self, name: str, kind: socket.SocketKind) -> socket.socket:
        """Make a socket of this process's on a machine."""
        with cable.inside(self.namespace(name)):
            made = socket.socket(socket.AF_INET, kind)
        made.settimeout(DEADLINE_S)
        return made

    def fault(self, name: str | None, fault: Fault = SOUND) -> float:
        """Set what is wrong with a machine's cable, or with all; by default nothing.

        Return since when it is in force at the latest, by CLOCK_MONOTONIC.
        """
        order = {"machine": name, "fault": asdict(fault)}
        at_s: float = self._ask(order)["at_s"]
        return at_s

    def packets(self) -> tuple[int, int]:
        """Return how many packets were carried, and how many lost."""
        counted = self._ask({})
        return counted["carried"], counted["lost"]

    def close(self) -> int:
        """Remove them, and return the cable's exit code.

        Processes that still run there keep their network, but for the cable.
        """
        self._process.communicate(timeout=DEADLINE_S)
        return self._process.returncode

    def _ask(self, order: dict[str, Any]) -> dict[str, Any]:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        readable, _, _ = select.select([self._process.stdout], [], [], DEADLINE_S)
        line = self._process.stdout.readline() if readable else ""
        assert line, f"the cable does not answer: exit code {self._process.poll()}"
        answer: dict[str, Any] = json.loads(line)
        return answer


@contextlib.contextmanager
def machines(*names: str, seed: int = 1) -> Iterator[Machines]:
    """Have machines for a while."""
    made = Machines(*names, seed=seed)
    try:
        yield made
    finally:
        code = made.close()
    assert code == 0, "the cable has failed: what it said is in the standard error"


@cache
def missing() -> str | None:
    """Return why this machine cannot have others within it, or None."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "there is no program `ip` (package iproute2)"
    try:
        os.close(os.open(cable.TUN, os.O_RDWR))
    except OSError as error:
        return f"there are no TUN devices: {cable.TUN}: {error.strerror}"
    name = f"litegrip-{os.getpid()}-probe"
    command = ["ip", "netns", "add", name]
    tried = subprocess.run(command, capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        return f"no network namespace can be made: {tried.stderr.strip()}"
    cable.remove(name)
    return None
