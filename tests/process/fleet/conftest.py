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


@pytest.fixture(scope="module")
def site(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    certificates: Path,
    shared: DaemonProcess,
) -> Iterator[Fleet]:
    """One fleet for all tests of a module, which says in FLEET what it has to be like."""
    shared.connect().close()
    options = getattr(request.module, "FLEET", {})
    sockets = {"left": shared.socket_path}
    with fleet(tmp_path_factory.mktemp("site"), certificates, sockets, **options) as running:
        yield running


@pytest.fixture
def lab(site: Fleet, gripper: DaemonProcess) -> Fleet:
    """Return the module's fleet; whatever a test has killed or frozen in it runs again."""
    site.mend()
    return site
