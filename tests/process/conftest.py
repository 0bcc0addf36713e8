"""A daemon with the simulated gripper, for tests of whole processes."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DaemonProcess, daemon


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[DaemonProcess]:
    """The motor's watchdog is as slow as motors have it: a busy machine may stop the daemon for
    longer than the usual 0.1 s, and the motor then faults, as it must."""
    config = tmp_path / "simulated.toml"
    config.write_text(
        '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n',
        encoding="utf-8",
    )
    with daemon(tmp_path, f"sim-{os.getpid()}", "--config", str(config)) as running:
        yield running
