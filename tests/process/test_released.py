"""Released versions as real processes: their daemon and this client, their client and this daemon.

Of each version few processes, which do much: one makes every call, one every command.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.client.ctl_commands import LINES
from tests.process.daemon_process import DaemonProcess, begin_again, configured, ran
from tests.process.test_ctl_json import CODES
from tests.versions import steps
from tests.versions.released import RELEASED, Release, is_later, unpacked

ROOT = Path(__file__).parents[2]
CHANNEL = f"sim-{os.getpid()}"
WITHIN_S = 110.0
IS_NIGHT = os.environ.get("LITEGRIPD_PROPERTIES") == "nightly"

WHERE = "import litegripd, litegrip_client; print(litegripd.__file__, litegrip_client.__file__)"


@pytest.fixture(scope="module", params=RELEASED)
def release(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Release:
    """Unpack a version, and see that Python finds it there."""
    folder = tmp_path_factory.mktemp("released")
    release = unpacked(request.param, folder / "released")
    command = [sys.executable, "-c", WHERE]
    found = subprocess.run(
        command, env=release.environment(), cwd=folder, capture_output=True, text=True, check=True
    )
    assert all(Path(one).is_relative_to(release.folder) for one in found.stdout.split())
    return release


def environment_of(packages: Path, folder: Path) -> dict[str, str]:
    """Return an environment for a program that uses the client among these packages."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("LITEGRIP")}
    return {
        **own,
        "PYTHONPATH": str(packages),
        "HOME": str(folder),
        "LITEGRIP_TRAJ_DIR": str(folder / "own"),
        "XDG_RUNTIME_DIR": str(folder),
        "LITEGRIP_CHANNEL": CHANNEL,
    }


def told_by_client(socket: Path, packages: Path, folder: Path, **wanted: object) -> list[Any]:
    """Have a program use the client among these packages; return what it tells."""
    folder.mkdir()
    done = ran(
        sys.executable,
        steps.__file__,
        str(socket),
        within_s=WITHIN_S,
        input=json.dumps(wanted),
        env=environment_of(packages, folder),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    client, *told = map(json.loads, done.stdout.splitlines())
    assert client == {"client": str(packages / "litegrip_client")}
    return told


@pytest.fixture(scope="module", params=["released daemon", "released client"])
def pair(
    request: pytest.FixtureRequest, release: Release, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[DaemonProcess, Path]]:
    """Run a daemon; give it, and the packages of the client that is to use it."""
    folder = tmp_path_factory.mktemp("pair")
    is_daemon = request.param == "released daemon"
    daemons = release.folder if is_daemon else ROOT
    on = ("env", f"--chdir={daemons}", f"PYTHONPATH={daemons}")
    with configured(folder / "daemon", CHANNEL, on=on) as running:
        with running.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
            helper = client.until_health(lambda health: bool(health["helper"]["pid"]))["helper"]
        command = Path(f"/proc/{helper['pid']}/cmdline").read_text()
        assert (str(release.folder) in command) is is_daemon, "it is of another version"
        yield running, ROOT if is_daemon else release.folder


def test_every_call(release: Release, pair: tuple[DaemonProcess, Path], tmp_path: Path) -> None:
    running, packages = pair
    begin_again(running)
    names = [name for name in steps.STEPS if not is_later(name, release.version)]
    names = [name for name in names if name not in steps.LONG]  # `litegripctl zero` is tried below
    told = told_by_client(running.socket_path, packages, tmp_path / "c", steps=names)
    assert told == [{"step": name} for name in (*names, "asyncio")]


def test_every_command(release: Release, pair: tuple[DaemonProcess, Path], tmp_path: Path) -> None:
    running, packages = pair
    if packages == release.folder and not IS_NIGHT:
        pytest.skip("the released client's commands take half a minute: make nightly tries them")
    begin_again(running)
    lines = [line for line in LINES if not is_later(line, release.version)]
    lines = [line for line in lines if not line.startswith("restart")]  # it has no parent to be of
    if (
        packages == release.folder
    ):  # the fleet's package is this version's, and fits no older client
        lines = [line for line in lines if not line.startswith("fleet")]
    wanted = [(line, [*CODES.get(line, {0})]) for line in lines]
    told = told_by_client(running.socket_path, packages, tmp_path / "c", lines=wanted)
    assert [one["line"] for one in told] == lines
    assert [one for one in told if one["code"] not in CODES.get(one["line"], {0})] == []
