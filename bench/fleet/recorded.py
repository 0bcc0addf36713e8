"""What a daemon with a simulated gripper answers, for the stand-ins of `bench.fleet.standin`."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.__main__ import wait_for
from bench.hostile.raw_connection import Connection

ASKED = (
    "hello",
    "rpc.discover",
    "events.subscribe",
    "state.get",
    "state.subscribe",
    "health",
    "lease.get",
)
PARAMS = {"events.subscribe": {"kinds": ["stop"]}, "state.subscribe": {"hz": 50}}
SAMPLE = "sample"
"""The name of the notification among the answers."""


def record(file: Path) -> None:
    """Run a daemon for a moment; write the results of `ASKED`, and one sample, to `file`."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "rpc.sock"
        channel = f"recorded-{os.getpid()}"
        command = [sys.executable, "-m", "litegripd.app.main", channel, "--simulate"]
        daemon = subprocess.Popen(
            [*command, "--socket", str(path)],
            stdin=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            wait_for(path)
            file.write_text(json.dumps(_answers(path)), encoding="utf-8")
        finally:
            daemon.terminate()
            daemon.wait()


def _answers(path: Path) -> dict[str, object]:
    answers: dict[str, object] = {}
    with Connection(path) as connection:
        for method in ASKED:
            request = {"jsonrpc": "2.0", "id": 1, "method": method}
            request["params"] = PARAMS.get(method, {})
            connection.send(json.dumps(request).encode() + b"\n")
            answers[method] = connection.message()["result"]
        while (message := connection.message()).get("method") != "state.sample":
            pass
        answers[SAMPLE] = message["params"]
    return answers
