"""The commands of litegripctl in virtual time, and what each of them asks a daemon for."""

import contextlib
import io
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from litegrip_client.ctl.main import main
from tests.client.ctl_commands import LINES as ALL
from tests.client.ctl_commands import WITHOUT_DAEMON
from tests.versions.older import Change, Requests, Scene, a_scene, as_it_is

_ELSEWHERE = (*WITHOUT_DAEMON, "plot", "sim")
"""What asks no daemon for anything but `hello`, or only a simulated gripper's."""

LINES = (*(line for line in ALL if line.split()[0] not in _ELSEWHERE), "doctor")


def carried_out(line: str) -> tuple[int, str]:
    """Carry out a command line with --json; return the exit code and the output."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(io.StringIO()):
        code = main(["-c", "can0", "--json", *line.split()])
    return code, output.getvalue()


@contextlib.contextmanager
def a_shell(home: Path, change: Change = as_it_is) -> Iterator[Scene]:
    """Give a daemon whose gripper is enabled and nobody's, and a folder to be in."""
    with a_scene(home, change) as scene, pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        scene.gripper.disconnect()
        yield scene


@cache
def sent_by_lines(change: Change = as_it_is) -> dict[str, tuple[int, Requests]]:
    """Return the exit code of each command at a daemon, and what it sends there."""
    found: dict[str, tuple[int, Requests]] = {}
    with TemporaryDirectory() as folder, a_shell(Path(folder) / "home", change) as scene:
        for line in LINES:
            scene.requests.clear()
            code, _ = carried_out(line)
            found[line] = code, list(scene.requests)
    return found
