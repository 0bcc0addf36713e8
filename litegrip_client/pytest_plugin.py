"""The fixture of `litegrip_client.testing`, which pytest finds by itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from litegrip_client.testing import SimulatedDaemon


@pytest.fixture
def simulated_gripper() -> Iterator[SimulatedDaemon]:
    """Give a test a daemon on a simulated gripper of its own; nothing is between the jaws."""
    from litegrip_client.testing import simulated  # noqa: PLC0415 - each start of pytest comes here

    with simulated() as daemon:
        yield daemon
