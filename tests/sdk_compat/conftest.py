from collections.abc import Iterator
from pathlib import Path

import pytest

from litegrip_client import LiteGrip
from tests.drop_in import Daemon, Site, a_site

MOUNTS = ("normal", "reverse")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    path = tmp_path / "home"
    path.mkdir()
    return path


@pytest.fixture
def site(home: Path) -> Iterator[Site]:
    with a_site(home) as site:
        yield site


@pytest.fixture(params=MOUNTS)
def mount(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def daemon(site: Site, mount: str) -> Daemon:
    """Return a calibrated gripper's daemon on can0, the jaws 60 mm open and the motor disabled."""
    return site.add(Daemon(mount=mount))


@pytest.fixture
def gripper(daemon: Daemon) -> Iterator[LiteGrip]:
    """Return the enabled gripper of that daemon."""
    with LiteGrip("can0") as gripper:
        assert gripper.enable()
        yield gripper
