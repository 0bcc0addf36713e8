"""Runs what `make run` runs, and reads what it says."""

import contextlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.process.daemon_process import DEADLINE_S

PROGRAM = Path(__file__).parents[2] / "examples" / "run_simulated.py"


class Run:
    """A program that was started, and what it has said up to `Ctrl-C ends`."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(PROGRAM), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "HOME": str(folder), "STATE_DIRECTORY": str(folder / "state")},
        )
        self.said = ""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said += line
            if line.startswith("Ctrl-C ends"):
                break

    @property
    def page(self) -> str:
        found = re.search(r"http://127\.0\.0\.1:\d+/#\S{43}", self.said)
        assert found, self.said
        return found[0]

    def end(self) -> int:
        self.process.terminate()
        more, _ = self.process.communicate(timeout=DEADLINE_S)
        self.said += more
        return self.process.returncode


@contextlib.contextmanager
def run(folder: Path, *arguments: str) -> Iterator[Run]:
    started = Run(folder, *arguments)
    try:
        yield started
    finally:
        assert started.end() == 0, started.said
