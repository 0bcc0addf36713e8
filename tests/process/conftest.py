"""A daemon with the simulated gripper, for tests of whole processes.

With LITEGRIPD_THROUGH_PORTAL=1 it is met through portal, router and gateway, as on another machine;
tests that meet none in that way are not run then.
"""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.by_portal import Met, by_portal, is_remote
from tests.process.daemon_process import DaemonProcess, begin_again, configured
from tests.process.fleet.fleet_process import HOST, Fleet, make_certificates
from tests.process.fleet.lab import CERTIFICATES


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out, where daemons are met through a portal, the tests that do not meet any."""
    if not is_remote():
        return
    meets = {item: "met" in getattr(item, "fixturenames", ()) for item in items}
    left_out = [item for item in items if not meets[item]]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if meets[item]]


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the certificates of a run: whichever worker comes first does, keys take long."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "certificates"
    folder.mkdir(exist_ok=True)
    whole = folder / "whole"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            names = ("user:viewer", "user:former", "gateway:forger", *CERTIFICATES)
            make_certificates(folder, HOST, *names)
            whole.touch()
    return folder


@pytest.fixture
def met(request: pytest.FixtureRequest, tmp_path: Path) -> Met:
    """Return what lets daemons be met as LITEGRIPD_THROUGH_PORTAL says: here, or by a portal.

    It is called once they listen. A test that is `local_only` is skipped where it is a portal.
    """
    local_only = request.node.get_closest_marker("local_only")
    if is_remote() and local_only is not None:
        pytest.skip(local_only.args[0])

    @contextlib.contextmanager
    def meeting(*daemons: DaemonProcess) -> Iterator[Fleet | None]:
        if not is_remote():
            yield None
            return
        for running in daemons:
            running.connect().close()
        certificates = request.getfixturevalue("certificates")
        with by_portal(tmp_path / "fleet", certificates, *daemons) as lab:
            yield lab

    return meeting


@pytest.fixture
def own(met: Met, tmp_path: Path) -> Iterator[DaemonProcess]:
    """A daemon for one test alone: what it kills, keeps or counts is its own."""
    with configured(tmp_path, f"sim-{os.getpid()}") as running, met(running):
        yield running


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaemonProcess]:
    """One daemon for all tests of a module; each takes it as `simulated`."""
    with configured(tmp_path_factory.mktemp("shared"), f"shared-{os.getpid()}") as running:
        yield running


@pytest.fixture
def simulated(shared: DaemonProcess, met: Met) -> Iterator[DaemonProcess]:
    """The module's daemon as it was at its beginning, but for what it has counted and kept."""
    begin_again(shared)
    with met(shared):
        yield shared
