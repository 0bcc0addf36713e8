"""Runs the command `litegrip-sim` as a process of its own, for tests, with somebody beside it."""

import contextlib
import select
import signal
import subprocess
import sys
from collections.abc import Iterator

DEADLINE_S = 20.0


class SimulatorProcess:
    """A running simulator: the first line that it printed, and how it ends."""

    first_line = ""

    def __init__(self, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.sim.attended", *arguments],
            bufsize=0,  # so that a line that waits to be read can be seen by select
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def write(self, *lines: str) -> None:
        """Do something to it, as `tests.sim.attended` reads it."""
        assert self._process.stdin is not None
        self._process.stdin.write("".join(f"{line}\n" for line in lines).encode())

    def read_line(self) -> str:
        """Wait for a line of output; an empty one means that the process has ended."""
        assert self._process.stdout is not None
        readable, _, _ = select.select([self._process.stdout], [], [], DEADLINE_S)
        assert readable, "the simulator printed nothing"
        return self._process.stdout.readline().decode().strip()

    def end(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
        """Send a signal; return the exit code and what was printed as errors."""
        self._process.send_signal(number)
        _, errors = self._process.communicate(timeout=DEADLINE_S)
        return self._process.returncode, errors.decode()

    def kill(self) -> None:
        """End it for certain, whatever state the test left it in."""
        if self._process.poll() is None:
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()
        self._process.wait(timeout=DEADLINE_S)


@contextlib.contextmanager
def simulator(*arguments: str) -> Iterator[SimulatorProcess]:
    """Run the simulator, and leave no process behind."""
    process = SimulatorProcess(*arguments)
    try:
        process.first_line = process.read_line()
        assert process.first_line, process.end()
        yield process
    finally:
        process.kill()
