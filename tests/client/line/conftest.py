from collections.abc import Iterator
from typing import cast

import pytest

from litegrip_client.aio.gripper import Connection as AsyncConnection
from litegrip_client.line.connection import Connection
from tests.client.fake_daemon import DEADLINE_S, FakeDaemon
from tests.client.rig import Asyncio


@pytest.fixture(params=["threads", "asyncio"])
def connection(request: pytest.FixtureRequest, daemon: FakeDaemon) -> Iterator[Connection]:
    """Return a connection of each kind; what is of asyncio blocks as the other one does."""
    if request.param == "threads":
        with Connection(daemon.path, DEADLINE_S) as connection:
            yield connection
        return
    kind = Asyncio()
    connection = cast("Connection", kind.lend(AsyncConnection.open(daemon.path, DEADLINE_S)))
    yield connection
    connection.close()
    kind.close()


@pytest.fixture
def shared(daemon: FakeDaemon) -> Iterator[Connection]:
    """Return a connection that threads share."""
    with Connection(daemon.path, DEADLINE_S) as connection:
        yield connection
