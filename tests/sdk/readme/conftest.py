from collections.abc import Iterator

import pytest

from litegrip_client import LiteGrip
from tests.drop_in import Daemon


@pytest.fixture
def gripper(daemon: Daemon) -> Iterator[LiteGrip]:
    """Return the enabled gripper of that daemon, by the project's own client."""
    with LiteGrip("can0") as gripper:
        assert gripper.enable()
        yield gripper
