"""Two daemons with simulated grippers that teleoperate, and what stands between them."""

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess, daemon

CONFIG = '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "{mount}"\n'


@contextlib.contextmanager
def gripper(folder: Path, name: str, mount: str = "normal") -> Iterator[DaemonProcess]:
    """Run a daemon whose motor's watchdog is as slow as motors have it."""
    folder.mkdir(exist_ok=True)
    config = folder / "gripper.toml"
    config.write_text(CONFIG.format(mount=mount), encoding="utf-8")
    with daemon(folder, f"{name}-{os.getpid()}", "--config", str(config)) as running:
        yield running


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
