"""A daemon with the simulated gripper, for tests of whole processes."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DaemonProcess, daemon


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[DaemonProcess]:
    with daemon(tmp_path, f"sim-{os.getpid()}", "--simulate") as running:
        yield running
