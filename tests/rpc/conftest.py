"""Every message to a client of these tests is held against the daemon's own description of it."""

import pytest

from tests.world import Client


@pytest.fixture(autouse=True)
def described_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Client, "is_checked", True)
