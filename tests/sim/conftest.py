"""What the tests of faults share."""

from collections.abc import Iterator

import pytest

from tests.sim.faulty import Rig


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig()
    yield made
    made.faults.replug()
    made.bus.shutdown()
