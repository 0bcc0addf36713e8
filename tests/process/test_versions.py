"""Two versions side by side, and a link that leads to one of them: what runs never mixes them."""

import os
import shutil
import signal
import sys
import sysconfig
import time
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import DEADLINE_S, Client
from tests.process.restarting import (
    Restartable,
    held,
    holds,
    is_of_silence,
    restartable,
    wait_for_end,
)

SOURCES = Path(__file__).parents[2]
PROGRAM = SOURCES / "litegripd/app/litegripd"

EXECUTE = "import os, sys; os.execv(sys.argv[1], sys.argv[1:])"
"""Runs a program as systemd does."""


class Versions:
    """Directories with an environment each, and the link `litegripd` to one of them."""

    def __init__(self, folder: Path, *, is_made_by_link: bool) -> None:
        self.link = folder / "litegripd"
        self._folder = folder / "litegripd-versions"
        for version in ("1.0", "2.0"):
            self.switch(version)
            python = (self.link if is_made_by_link else self[version]) / "bin/python3"
            self._fill(self[version], version, python)
        self.switch("1.0")

    def __getitem__(self, version: str) -> Path:
        return self._folder / version

    def switch(self, version: str) -> None:
        """Have the link lead elsewhere, at no time nowhere."""
        new = self.link.with_name("litegripd.new")
        new.symlink_to(self[version])
        new.replace(self.link)

    @staticmethod
    def _fill(prefix: Path, version: str, python: Path) -> None:
        venv.create(prefix, symlinks=True)
        name = f"python{sys.version_info.major}.{sys.version_info.minor}"
        packages = prefix / "lib" / name / "site-packages"
        (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
        for package in ("litegripd", "litegrip_client"):
            shutil.copytree(SOURCES / package, packages / package)
        metadata = packages / f"litegripd-{version}.dist-info/METADATA"
        metadata.parent.mkdir()
        metadata.write_text(f"Metadata-Version: 2.1\nName: litegripd\nVersion: {version}\n")
        script = prefix / "bin/litegripd"
        script.write_text(f"#!{python}\n{PROGRAM.read_text().partition(chr(10))[2]}")
        script.chmod(0o755)


@pytest.fixture(params=[False, True], ids=["made in its place", "made by way of the link"])
def versions(tmp_path: Path, request: pytest.FixtureRequest) -> Versions:
    return Versions(tmp_path, is_made_by_link=request.param)


@pytest.fixture
def daemon(tmp_path: Path, versions: Versions) -> Iterator[Restartable]:
    with restartable(tmp_path, ("-c", EXECUTE, str(versions.link / "bin/litegripd"))) as running:
        yield running


def version_of(client: Client) -> str:
    return str(client.result("hello")["version"])


def command_of(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text()


def helper_killed(client: Client) -> int:
    """Kill the helper process; return the next one's pid."""
    before = client.until_health(lambda h: bool(h["helper"]["pid"]))["helper"]
    os.kill(before["pid"], signal.SIGKILL)
    after = client.until_health(
        lambda h: bool(h["helper"]["deaths"] > before["deaths"] and h["helper"]["pid"])
    )
    client.result("calibration.templates")  # it works
    return int(after["helper"]["pid"])


def test_who_runs_stays_with_its_version_and_who_follows_has_the_new_one_if_that_can_run(
    daemon: Restartable, versions: Versions
) -> None:
    with daemon.connect() as client:
        assert version_of(client) == "1.0"
        versions.switch("2.0")
        command = command_of(helper_killed(client))
        assert command.startswith(f"{versions['1.0']}/bin/python3\0")
        assert f"{versions['1.0']}/lib" in command
        assert str(versions["2.0"]) not in command
        assert f"{versions.link}/" not in command
    for version in ("2.0", "1.0"):  # there, and back again
        versions.switch(version)
        restart_holding(daemon)
        with daemon.connect() as client:
            assert version_of(client) == version
            assert command_of(helper_killed(client)).startswith(f"{versions[version]}/bin/python3")
    versions.switch("2.0")
    (versions["2.0"] / "bin/litegripd").unlink()
    answer = answer_to_restart(daemon)
    assert answer["error"]["data"]["reason"] == "restart_failed"
    assert "the successor cannot be started: " in answer["error"]["message"]
    with daemon.connect() as client:
        assert version_of(client) == "1.0"


def restart_holding(daemon: Restartable) -> None:
    """Restart while something is held, which goes on being held unless this machine is too busy."""
    mark, pid = len(daemon.log), daemon.pid
    answer = answer_to_restart(daemon)
    assert "result" in answer, answer
    wait_for_end(pid)
    with daemon.connect() as client:
        state = client.result("state.get")
        client.result("calibration.templates")  # by now the helper has written the log
        assert holds(state) or daemon.disturbed_since(mark), state


def answer_to_restart(daemon: Restartable) -> dict[str, Any]:
    """Ask for a restart while something is held, again where this machine was too busy for that."""
    ends_s = time.monotonic() + DEADLINE_S
    while True:
        with daemon.connect() as client:
            held(client)
            answer = daemon.restart(client)
        if not is_of_silence(answer):
            return answer
        assert time.monotonic() < ends_s, answer
