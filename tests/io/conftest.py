"""A reactor with a server at a socket, for tests of the transport."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.io.loop import Loop, running


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Loop]:
    with running(tmp_path / "rpc.sock") as made:
        yield made
