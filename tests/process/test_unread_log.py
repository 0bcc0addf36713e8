"""A daemon whose standard error nobody reads works, says so, and ends."""

import os
import signal
from pathlib import Path

from tests.io.test_standard_error import fill
from tests.process.daemon_process import DEADLINE_S, DaemonProcess


def test_a_full_pipe_as_standard_error_hangs_neither_helper_nor_end(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    fill(writer)
    socket_path = tmp_path / "rpc.sock"
    name = f"unread-{os.getpid()}"
    running = DaemonProcess(tmp_path, name, "--simulate", "--socket", str(socket_path), log=writer)
    os.close(writer)
    try:
        with running.connect() as client:
            for _ in range(3):
                assert client.result("calibration.templates")["templates"]
            health = client.until_health(lambda found: bool(found["log"]["is_stuck"]))
            assert health["verdict"] == "degraded"
            assert any("standard error" in reason for reason in health["reasons"])
        running.process.send_signal(signal.SIGTERM)
        assert running.process.wait(DEADLINE_S) == 0
    finally:
        running.kill()
        os.close(reader)
