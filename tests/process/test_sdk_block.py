"""The SDK's first example as a user runs it: a script, its import changed, and a daemon."""

import os
import subprocess
import sys
from pathlib import Path

from tests.process.by_portal import Met
from tests.process.daemon_process import DaemonProcess, configured, ran
from tests.sdk.readme import blocks

TRIES = 4
"""A daemon that is kept off the processor loses its simulated motor: then a user tries again."""


def run_script(running: DaemonProcess, channel: str) -> "subprocess.CompletedProcess[str]":
    source = blocks.source("quick_start")
    assert '"can0"' in source
    return ran(
        sys.executable,
        "-c",
        source.replace('"can0"', f'"{channel}"'),
        within_s=60,
        env={**os.environ, "LITEGRIPD_SOCKET": str(running.socket_path)},
    )


def test_quick_start(met: Met, tmp_path: Path) -> None:
    with (
        configured(tmp_path / "daemon", "can0") as running,
        met(running),
        running.connect() as client,
    ):
        client.until(lambda state: bool(state["motor"] == "disabled"))
        channel = client.result("hello")["channel"]
        done = run_script(running, channel)
        for _ in range(TRIES - 1):
            if "HardwareError" in done.stderr:
                done = run_script(running, channel)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout == "True False 0\n"  # nothing was between the jaws
        state = client.until(lambda state: bool(state["motor"] == "disabled"))
        assert state["openness"] < 0.1
