"""A fleet on this machine: a daemon on a simulated gripper, a gateway, a router and a portal."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DaemonProcess, begin_again
from tests.process.fleet.fleet_process import Fleet, fleet


@pytest.fixture
def gripper(shared: DaemonProcess) -> DaemonProcess:
    """Return the module's daemon as it was at its beginning."""
    begin_again(shared)
    return shared


@pytest.fixture
def lab(tmp_path: Path, certificates: Path, gripper: DaemonProcess) -> Iterator[Fleet]:
    with fleet(tmp_path / "fleet", certificates, {"left": gripper.socket_path}) as running:
        yield running
