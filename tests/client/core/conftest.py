from collections.abc import Iterator
from pathlib import Path

import pytest

from litegrip_client import LiteGrip
from tests.client.rig import Bench, Heard, Kind, a_bench


@pytest.fixture
def site(home: Path) -> Iterator[Bench]:
    with a_bench(home) as site:
        yield site


@pytest.fixture
def daemon(site: Bench) -> Heard:
    """Return a calibrated gripper's daemon on can0, the jaws 60 mm open and the motor disabled."""
    daemon = Heard()
    site.add(daemon)
    return daemon


@pytest.fixture
def gripper(daemon: Heard, kind: Kind) -> Iterator[LiteGrip]:
    """Return a connected gripper, of each kind."""
    with kind.gripper() as gripper:
        yield gripper


@pytest.fixture
def enabled(gripper: LiteGrip) -> LiteGrip:
    """Return one that is enabled."""
    assert gripper.enable()
    return gripper
