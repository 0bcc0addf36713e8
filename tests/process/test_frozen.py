"""A daemon that is stopped by a signal while somebody waits for a motion: it is not waited for."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from tests.process.daemon_process import CTL, DEADLINE_S, DaemonProcess

SLOW = ("close", "--speed", "2")  # half a minute


@contextmanager
def closing(running: DaemonProcess) -> "Iterator[subprocess.Popen[str]]":
    """Have `litegripctl` move slowly; kill it at the end."""
    path = str(running.socket_path)
    command = [*CTL, "--socket", path, *SLOW]
    pipe = subprocess.PIPE
    with running.connect() as client:
        client.enabled()
        process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)
        try:
            client.until(lambda state: bool(state["mode"] == "moving"))
            yield process
        finally:
            process.kill()
            process.communicate()


def test_the_shell_ends_by_an_error_that_names_the_danger(simulated: DaemonProcess) -> None:
    with closing(simulated) as process:
        simulated.process.send_signal(signal.SIGSTOP)
        try:
            os.waitid(os.P_PID, simulated.process.pid, os.WSTOPPED)
            _, told = process.communicate(timeout=DEADLINE_S)
        finally:
            simulated.process.send_signal(signal.SIGCONT)
    assert process.returncode == 3
    assert "cut the motor's power" in told
