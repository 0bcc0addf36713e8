from collections.abc import Iterator

import pytest

from litegrip_client.line.connection import Connection
from tests.client.fake_daemon import DEADLINE_S, FakeDaemon
from tests.client.rig import Kind


@pytest.fixture
def site() -> None:
    """Time is the real one, and so are sockets."""


@pytest.fixture
def connection(daemon: FakeDaemon, kind: Kind) -> Iterator[Connection]:
    """Return a connection of each kind; what is of asyncio blocks as the other one does."""
    connection = kind.connect(daemon.path, DEADLINE_S)
    yield connection
    connection.close()
