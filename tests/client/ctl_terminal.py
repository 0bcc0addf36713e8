"""litegripctl as a program, also on a terminal that a test reads and types at."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from tests.client.fake_daemon import DEADLINE_S

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, str(ROOT / "litegrip_client/ctl/litegripctl")]


def start(*arguments: str, **streams: Any) -> subprocess.Popen[bytes]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}
    return subprocess.Popen([*COMMAND, *arguments], env=environment, **streams)


class Terminal:
    """A running litegripctl whose input and outputs are a terminal."""

    def __init__(self, *arguments: str, **streams: Any) -> None:
        self._terminal, inner = os.openpty()
        self._process = start(
            *arguments, **{"stdin": inner, "stdout": inner, "stderr": inner, **streams}
        )
        os.close(inner)
        self._shown = ""

    def expect(self, text: str) -> None:
        """Wait until `text` is shown, and go on behind it."""
        deadline_s = time.monotonic() + DEADLINE_S
        while text not in self._shown:
            assert self._read(deadline_s), f"{text!r} was not shown, but {self._shown!r}"
        self._shown = self._shown.partition(text)[2]

    def type(self, text: str) -> None:
        os.write(self._terminal, text.encode())

    def interrupt(self, number: int = signal.SIGINT) -> None:
        self._process.send_signal(number)

    def wait_until_stopped(self) -> None:
        os.waitid(os.P_PID, self._process.pid, os.WSTOPPED)

    def end(self) -> tuple[int, str]:
        """Wait for its end; give its exit code and what it still showed."""
        deadline_s = time.monotonic() + DEADLINE_S
        while self._read(deadline_s):
            continue
        os.close(self._terminal)
        return self._process.wait(DEADLINE_S), self._shown.replace("\r\n", "\n")

    def _read(self, deadline_s: float) -> bool:
        left_s = max(0.0, deadline_s - time.monotonic())
        if not select.select([self._terminal], [], [], left_s)[0]:
            self._process.kill()
            raise TimeoutError(f"litegripctl waits; it has shown {self._shown!r}")
        try:
            piece = os.read(self._terminal, 4096)
        except OSError:  # how a terminal says that its program has gone
            return False
        self._shown += piece.decode()
        return bool(piece)
