"""The demo of the README: a daemon, a process that grasps what it loses, one that watches."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import ran

DEMO = Path(__file__).parents[2] / "examples" / "demo.py"


@pytest.fixture
def folder() -> Iterator[Path]:
    """Return an empty folder whose path is short enough for sockets in it."""
    with tempfile.TemporaryDirectory(dir="/tmp") as path:
        yield Path(path)


def within(folder: Path) -> dict[str, str]:
    return {**os.environ, "TMPDIR": str(folder)}


def test_an_object_is_grasped_lost_and_grasped_again(folder: Path) -> None:
    done = ran(sys.executable, str(DEMO), within_s=100, env=within(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    watched = [line for line in done.stdout.splitlines() if line.startswith("watcher |")]
    assert any("moving    grasp" in line for line in watched)
    shown = [
        line.partition("|")[0].strip()
        for line in done.stdout.partition("object_lost")[0].splitlines()
    ]
    assert "watcher" in shown  # as it happens, not all of it at the end
    moved = [line for line in done.stdout.splitlines() if line.startswith("  mover |")]
    assert any("object_lost" in line for line in moved)
    assert "object_held, 39." in moved[-1]
    assert len(moved) < 20  # a bar that changes is for terminals
    assert done.stdout.rstrip().endswith(
        "The demo worked: an object was grasped, lost, and grasped again."
    )
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nothing_is_left_of_a_demo_that_is_interrupted(folder: Path, number: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-u", str(DEMO)],
        env=within(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as demo:
        assert demo.stdout is not None
        for line in demo.stdout:
            if line.startswith("  mover |"):
                break
        demo.send_signal(number)
        demo.stdout.read()  # to the end of all that had inherited it
    assert demo.returncode != 0
    assert list(folder.iterdir()) == []
