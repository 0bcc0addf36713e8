"""A fleet on this machine: a daemon on a simulated gripper, a gateway, a router and a portal."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import SIMULATED, DaemonProcess, daemon
from tests.process.fleet.fleet_process import Fleet, fleet


@pytest.fixture
def gripper(tmp_path: Path) -> Iterator[DaemonProcess]:
    config = tmp_path / "simulated.toml"
    config.write_text(SIMULATED, encoding="utf-8")
    with daemon(tmp_path / "left", f"left-{os.getpid()}", "--config", str(config)) as running:
        running.connect().close()
        yield running


@pytest.fixture
def lab(tmp_path: Path, certificates: Path, gripper: DaemonProcess) -> Iterator[Fleet]:
    with fleet(tmp_path / "fleet", certificates, {"left": gripper.socket_path}) as running:
        yield running
