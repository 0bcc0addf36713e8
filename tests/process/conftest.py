"""A daemon with the simulated gripper, for tests of whole processes.

With LITEGRIPD_THROUGH_PORTAL=1 it is met through portal, router and gateway, as on another machine.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import SIMULATED, DaemonProcess, daemon
from tests.process.fleet.fleet_process import HOST, fleet, make_certificates

THROUGH_PORTAL = "LITEGRIPD_THROUGH_PORTAL"


@pytest.fixture
def simulated(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[DaemonProcess]:
    is_remote = os.environ.get(THROUGH_PORTAL) == "1"
    local_only = request.node.get_closest_marker("local_only")
    if is_remote and local_only is not None:
        pytest.skip(local_only.args[0])
    config = tmp_path / "simulated.toml"
    config.write_text(SIMULATED, encoding="utf-8")
    with daemon(tmp_path, f"sim-{os.getpid()}", "--config", str(config)) as running:
        if is_remote:
            with through_portal(running, tmp_path) as remote:
                yield remote
        else:
            yield running


@contextlib.contextmanager
def through_portal(running: DaemonProcess, folder: Path) -> Iterator[DaemonProcess]:
    """Let a daemon be met at a portal's sockets."""
    running.connect().close()
    certificates = make_certificates(folder / "tls", HOST, "user:op1", "gateway:robot1")
    own = running.socket_path
    with fleet(folder / "fleet", certificates, {"left": own}, role="admin") as remote:
        running.socket_path, running.remote_as = remote.socket_path(), "op1@lab via gateway"
        yield running
        running.socket_path, running.remote_as = own, None
