"""A daemon over SLCAN that is restarted without letting go, for tests of whole processes."""

import contextlib
import os
import select
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.process.daemon_process import (
    BY_GATEWAY,
    DEADLINE_S,
    MODULE,
    SLCAN,
    Client,
    DaemonProcess,
)
from tests.sim.simulator_process import simulator

RATE_HZ = 100
CONFIG = f"{SLCAN}{BY_GATEWAY}[control]\nrate_hz = {RATE_HZ}\n"
"""At this rate a busy machine may keep pump and simulator away for 40 ms without any harm."""

OBJECT_MM = 40.0
FORCE_N = 8.0


class Restartable:
    """A daemon, and whoever follows it; `pid` is who it is now."""

    def __init__(self, folder: Path, terminal: str, program: tuple[str, ...] = MODULE) -> None:
        self.config, self._terminal = folder / "config.toml", terminal
        self.configure()
        self.channel, path = f"hold{os.getpid()}-{folder.name}", folder / "rpc.sock"
        arguments = (self.channel, "--config", str(self.config), "--socket", str(path))
        self.first = DaemonProcess(folder, *arguments, program=program)
        self.pid = self.first.process.pid

    def configure(self) -> None:
        """Write its first configuration, also in the place of another one."""
        self.config.write_text(CONFIG.format(channel=self._terminal), encoding="utf-8")

    @property
    def log(self) -> str:
        return self.first.log

    def connect(self) -> Client:
        """Connect, at once: the socket is always there."""
        return Client(self.first.socket_path)

    def disturbed_since(self, mark: int) -> bool:
        """True if the motor was silent, by the log from `mark` on."""
        return "motor: enabled ->" in self.log[mark:]

    def restart(self, client: Client) -> dict[str, Any]:
        """Restart; return the whole answer."""
        answer = client.call("daemon.restart", hold_through_restart=True)
        if "result" in answer:
            self.pid = answer["result"]["pid"]
        return answer

    def restart_despite_silence(self, client: Client) -> dict[str, Any]:
        """Restart, again while a busy machine silences the motor; return the whole answer."""
        ends_s = time.monotonic() + DEADLINE_S
        while is_of_silence(answer := self.restart(client)):
            assert time.monotonic() < ends_s, answer
        return answer

    def restart_at_last(self, client: Client) -> dict[str, Any]:
        """Restart, and again what this busy machine lets fail; return the result."""
        ends_s = time.monotonic() + DEADLINE_S
        while "result" not in (answer := self.restart(client)):
            assert time.monotonic() < ends_s, answer
        result: dict[str, Any] = answer["result"]
        return result

    def close(self) -> None:
        """End whoever runs; all of them were started by this test."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGTERM)
            wait_for_end(self.pid)
        self.first.kill()
        for pid in self._followers():  # of whom a test that failed has not heard
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            wait_for_end(pid)

    def _followers(self) -> list[int]:
        """Return who runs with this configuration: a terminal's next user cannot share it."""
        named = os.fsencode(self.config)
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(FileNotFoundError, ProcessLookupError, PermissionError):
                if named in (folder / "cmdline").read_bytes().split(b"\0"):
                    found.append(int(folder.name))
        return found


@contextlib.contextmanager
def restartable(folder: Path, program: tuple[str, ...] = MODULE) -> Iterator[Restartable]:
    """Run a daemon over SLCAN whose gripper has an object between its jaws."""
    with simulator("--pty", "--object-mm", str(OBJECT_MM)) as adapter:
        daemon = Restartable(folder, adapter.first_line, program)
        try:
            with daemon.first.connect() as client:
                client.enabled()
            yield daemon
        finally:
            daemon.close()


def is_of_silence(answer: dict[str, Any]) -> bool:
    """True if a restart was refused since the motor was silent, or is looked at after that."""
    if "result" in answer:
        return False
    is_read = "registers are being read" in answer["error"]["message"]
    return is_read or answer["error"]["data"]["reason"] == "motor_silent"


def wait_for_end(pid: int) -> None:
    """Wait until a process has ended that may be nobody's child here."""
    try:
        pidfd = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    try:
        assert select.select([pidfd], [], [], DEADLINE_S)[0], f"process {pid} does not end"
    finally:
        os.close(pidfd)


def held(client: Client) -> dict[str, Any]:
    """Let the jaws hold the object by force; return the state then."""
    ends_s = time.monotonic() + DEADLINE_S
    while True:
        client.despite_silence("motion.grasp", force_n=FORCE_N, until="verdict")
        state = client.result("state.get")
        if holds(state):
            return state
        assert time.monotonic() < ends_s, state


def holds(state: dict[str, Any]) -> bool:
    """True if the object is held by force."""
    return bool(state["enabled"] and state["is_grasped"] and state["force_set_n"] == FORCE_N)
