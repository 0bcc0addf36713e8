"""The package `litegrip` over whole daemons in virtual time."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from litegrip_client import as_sdk

if as_sdk.FOLDER not in sys.path:
    sys.path.insert(0, as_sdk.FOLDER)

import litegrip
import litegrip.protocols
from tests.drop_in import Daemon, Site, a_site

MOUNTS = ("normal", "reverse")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    path = tmp_path / "home"
    path.mkdir()
    return path


_CLOCKED = (litegrip.gripper, litegrip._sessions, litegrip.protocols.can_bus)
"""The package's modules that wait, or read a clock."""


@pytest.fixture
def site(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    with a_site(home) as site:
        clock = SimpleNamespace(
            monotonic=lambda: site.now_s, sleep=site.turns.sleep, strftime=time.strftime
        )
        for module in _CLOCKED:
            monkeypatch.setattr(module, "time", clock)
        monkeypatch.setattr(litegrip._sessions, "threading", site.turns.threading)
        yield site


@pytest.fixture(params=MOUNTS)
def mount(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def daemon(site: Site, mount: str) -> Daemon:
    """Return a calibrated gripper's daemon on can0, the jaws 60 mm open and the motor disabled."""
    return site.add(Daemon(mount=mount))


@pytest.fixture
def gripper(daemon: Daemon) -> Iterator[litegrip.LiteGrip]:
    """Return the enabled gripper of that daemon, with its calibration."""
    with litegrip.LiteGrip("can0") as gripper:
        assert gripper.load_calibration()
        assert gripper.enable()
        yield gripper
