"""A whole daemon under a service manager that only listens: readiness, status, watchdog, end."""

import os
import resource
import select
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S, DaemonProcess, daemon
from tests.process.restarting import wait_for_end


class Manager:
    """A service manager's socket; `until` reads messages."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.settimeout(DEADLINE_S)

    def hears(self, within_s: float) -> bool:
        """True if a message comes in time."""
        return bool(select.select([self.socket], [], [], within_s)[0])

    def until(self, beginning: str) -> str:
        """Return the next message with this beginning; the others are passed over."""
        ends_s = time.monotonic() + DEADLINE_S
        while True:
            message = self.socket.recv(4096).decode()
            if message.startswith(beginning):
                return message
            assert time.monotonic() < ends_s, f"the manager is not told {beginning}"


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    manager = Manager(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    yield manager
    manager.socket.close()


def test_the_manager_is_told_how_the_daemon_fares(tmp_path: Path, manager: Manager) -> None:
    with daemon(tmp_path, f"told{os.getpid()}", "--simulate") as running:
        assert manager.until("READY") == "READY=1"
        manager.until("WATCHDOG=1")
        assert manager.until("STATUS=disabled").startswith("STATUS=disabled, 0 clients, ")
        with running.connect() as client:
            client.enabled()
            assert manager.until("STATUS=holding").startswith("STATUS=holding, 1 client, ")
        running.process.send_signal(signal.SIGTERM)
        assert manager.until("STOPPING") == "STOPPING=1"


def test_a_daemon_that_is_stopped_feeds_no_watchdog(tmp_path: Path, manager: Manager) -> None:
    with daemon(tmp_path, f"still{os.getpid()}", "--simulate") as running:
        manager.until("WATCHDOG=1")
        running.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, running.process.pid, os.WSTOPPED)
        while manager.hears(0.0):  # what it has said before
            manager.socket.recv(4096)
        assert not manager.hears(1.0), "longer than the watchdog's 0.4 s"
        running.process.send_signal(signal.SIGCONT)
        manager.until("WATCHDOG=1")


def test_an_abort_tells_where_the_thread_was_and_keeps_the_last_minute(
    tmp_path: Path, manager: Manager
) -> None:
    arguments = (f"abort{os.getpid()}", "--simulate", "--socket", str(tmp_path / "rpc.sock"))
    running = DaemonProcess(tmp_path, *arguments)
    try:
        manager.until("WATCHDOG=1")
        with running.connect() as client:
            helper = int(client.result("health")["helper"]["pid"])
        resource.prlimit(running.process.pid, resource.RLIMIT_CORE, (0, 0))
        # As a manager does when its watchdog has expired: to each process of the unit.
        os.kill(helper, signal.SIGABRT)
        running.process.send_signal(signal.SIGABRT)
        assert running.exit_code() == -signal.SIGABRT
        wait_for_end(helper)
        assert "its last minute is recorded in" in running.log
        assert "Fatal Python error: Aborted" in running.log
    finally:
        running.kill()
