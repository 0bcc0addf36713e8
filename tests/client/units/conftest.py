from pathlib import Path

import pytest

from litegrip_client.ctl import install
from tests.client.units.system import PROGRAMS, System


@pytest.fixture
def system(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> System:
    """Return a system on which nothing is installed; the programs are in an environment in /opt."""
    monkeypatch.setattr(install, "program_directory", lambda: PROGRAMS)
    return System(tmp_path / "root", capsys)
