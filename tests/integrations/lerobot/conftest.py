from collections.abc import Iterator
from pathlib import Path

import pytest

from litegripd.teleop.link import InProcessLinks
from tests.client.rig import Bench, Heard, a_bench


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """Return a machine in virtual time."""
    for name in ("LITEGRIPD_SOCKET", "LITEGRIP_CHANNEL", "LITEGRIP_CALIB"):
        monkeypatch.delenv(name, raising=False)
    with a_bench(tmp_path) as site:
        yield site


@pytest.fixture
def links() -> InProcessLinks:
    """Return what carries teleoperation between the daemons."""
    return InProcessLinks()


@pytest.fixture
def lead(site: Bench, links: InProcessLinks) -> Iterator[Heard]:
    """Return the daemon of the gripper that leads, built the other way round."""
    daemon = Heard("lead", "reverse", links=links)
    site.add(daemon)
    yield daemon
    assert all(stream.hung_up for stream in daemon.streams), "a connection is left open"


@pytest.fixture
def follow(site: Bench, links: InProcessLinks) -> Iterator[Heard]:
    """Return the daemon of the gripper that follows, 60 mm open."""
    daemon = Heard("follow", links=links)
    site.add(daemon)
    yield daemon
    assert all(stream.hung_up for stream in daemon.streams), "a connection is left open"
