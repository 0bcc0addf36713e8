from pathlib import Path

import pytest

from litegrip_client.ctl.doctor import gather
from litegrip_client.socketcan import link as can_link


class Programs:
    """The one directory in which programs are looked for; there is none yet."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()

    def says(self, name: str, script: str) -> None:
        """Put a script of the shell there."""
        program = self.folder / name
        program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        program.chmod(0o755)


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Programs:
    found = Programs(tmp_path / "bin")
    monkeypatch.setenv("PATH", str(found.folder))
    monkeypatch.setattr("sys.executable", str(tmp_path / "nowhere/python"))
    monkeypatch.setattr(can_link, "_ADMIN_PATHS", ())
    return found


@pytest.fixture
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the directory of configurations, in which there is none."""
    path = tmp_path / "etc"
    path.mkdir()
    monkeypatch.setattr(gather, "DIRECTORY", path)
    return path
