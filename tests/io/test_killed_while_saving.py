"""The process that saves calibrations is killed for real; what it leaves is always readable."""

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from litegripd.io.helper.files import find_calibration
from tests.io.saver_for_tests import CHANNEL, MOUNTS, content, save

DEADLINE_S = 30.0
KILLS = 50
FILE = f"{CHANNEL}_calibration.json"
PREVIOUS = f"{CHANNEL}_calibration.previous.json"


class Saver:
    """The program that forks the children that save."""

    def __init__(self, root: Path) -> None:
        self.root = root
        command = [sys.executable, "-m", "tests.io.saver_for_tests", str(root)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.input, self.output = self.process.stdin, self.process.stdout

    def start(self, command: bytes) -> int:
        """Start a child; return its process id."""
        self.input.write(command)
        digits = b""
        while not digits.endswith(b"\n"):
            digits += self.read()
        return int(digits)

    def read(self) -> bytes:
        """Return the next byte that the program writes."""
        assert select.select([self.output], [], [], DEADLINE_S)[0], "it writes nothing"
        byte = self.output.read(1)
        assert byte, "it has ended"
        return byte

    def kill(self, pid: int) -> None:
        """Kill a child and wait until it has gone."""
        os.kill(pid, signal.SIGKILL)
        while self.read() != b"E":
            pass  # starts that it reported before it died

    def close(self) -> None:
        """End the program; a child that still saves ends at its next report."""
        self.input.close()
        self.output.close()
        self.process.wait(DEADLINE_S)


@pytest.fixture
def saver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Saver]:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))  # `save` sets it, this sets it back
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    for mount in MOUNTS:
        save(tmp_path, mount, 0)
    made = Saver(tmp_path)
    yield made
    made.close()


def saved_variant(root: Path, mount: str) -> int:
    """Return which variant the daemon would find; fail for anything but one that was saved."""
    os.environ["STATE_DIRECTORY"] = str(root / mount)
    found = find_calibration(CHANNEL, None)
    assert found.path == root / mount / FILE
    assert found.calibration is not None
    assert found.calibration.geometry.mount == mount
    variant = round(found.calibration.geometry.rad_to_mm - 70.0)
    assert found.calibration.content == content(mount, variant)
    return variant


def leftovers(root: Path, mount: str) -> set[str]:
    return {entry.name for entry in (root / mount).iterdir()} - {FILE, PREVIOUS}


def test_killed_at_any_moment_the_file_is_readable_and_of_the_same_mount(saver: Saver) -> None:
    for number in range(KILLS):
        pid = saver.start(b"f")
        for _ in range(1 + number % 7):
            assert saver.read() == b"."
        saver.kill(pid)
        for mount in MOUNTS:
            assert saved_variant(saver.root, mount) in (0, 1)
            previous = saver.root / mount / PREVIOUS
            if previous.exists():
                kept = json.loads(previous.read_text(encoding="utf-8"))
                assert kept in (content(mount, 0), content(mount, 1))
            assert len(leftovers(saver.root, mount)) <= 2
    for mount in MOUNTS:
        save(saver.root, mount, 3)
        assert saved_variant(saver.root, mount) == 3
        assert leftovers(saver.root, mount) == set()


def test_killed_between_any_two_calls_the_file_is_the_old_or_the_new_one(saver: Saver) -> None:
    found: list[int] = []
    left_over = 0
    for calls in range(1000):
        save(saver.root, "normal", 1)
        assert leftovers(saver.root, "normal") == set()
        pid = saver.start(b"2")
        reports = b""
        while len(reports) <= calls and not reports.endswith(b"E"):
            reports += saver.read()
            if len(reports) <= calls:
                saver.input.write(b"g")
        if reports.endswith(b"E"):
            break
        saver.kill(pid)
        found.append(saved_variant(saver.root, "normal"))
        left_over += bool(leftovers(saver.root, "normal"))
    assert saved_variant(saver.root, "normal") == 2
    assert found == sorted(found), "once it is the new one, it stays"
    assert set(found) == {1, 2}
    assert left_over > 3
