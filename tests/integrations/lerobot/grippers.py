"""Daemons on simulated grippers, one of which a hand moves, and a log of all that they do."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from litegrip_client import ConnectError, LiteGrip
from tests.integrations.lerobot.measures import Track

SWEEP_S, FROM_MM, TO_MM = 2.142, 20.0, 65.0
"""The hand: 45 mm and back, 66 mm/s at most."""
HAND = ("-m", "bench.teleop.handheld", str(SWEEP_S), str(FROM_MM), str(TO_MM))
CONFIG = f"""
[access]
gateways = [{os.getuid()}]
[bus]
interface = "litegrip_sim"
watchdog_s = 0.4
"""
ON_MUJOCO = 'mechanics = "mujoco"\n'
CALIBRATED = '[gripper]\nmount = "normal"\n'
FIELDS = ["feedback_s", "openness", "mode", "enabled", "stale"]
_WITHIN_S = 30.0


class Log:
    """Every tick of a daemon, 200 a second, from now on."""

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self.rows: list[dict[str, Any]] = []
        self._gripper = LiteGrip(channel)
        self._gripper.connect()
        self._states = self._gripper.states(200, FIELDS, batch=50)
        self._thread = threading.Thread(target=self._keep, daemon=True)
        self._thread.start()

    def _keep(self) -> None:
        try:
            self.rows.extend(self._states)
        except ConnectError:
            return

    def until(self, time_s: float) -> None:
        """Wait until the log reaches so far."""
        ends_s = time.monotonic() + _WITHIN_S
        while not self.rows or (self.rows[-1]["feedback_s"] or 0.0) < time_s:
            if time.monotonic() > ends_s:
                raise TimeoutError("the daemon logs nothing more")
            self._thread.join(0.05)

    def track(self) -> Track:
        """Return where the jaws were when."""
        found = {
            row["feedback_s"]: row["openness"]
            for row in list(self.rows)
            if row["feedback_s"] is not None and row["openness"] is not None
        }
        return Track(sorted(found), [found[one] for one in sorted(found)])

    def close(self) -> None:
        self._states.close()
        self._gripper.disconnect()
        self._thread.join()


@contextmanager
def daemon(
    folder: Path,
    name: str,
    *,
    by_hand: bool = False,
    calibrated: bool = True,
    mechanics: str = "",
) -> Iterator[str]:
    """Run a daemon until the end of the block; return its channel."""
    channel = f"{name}-{os.getpid()}"
    config = folder / f"{name}.toml"
    settings = CONFIG + mechanics + (CALIBRATED if calibrated else "")
    config.write_text(settings, encoding="utf-8")
    program = HAND if by_hand else ("-m", "litegripd.app.main")
    home = folder / name
    home.mkdir()
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, *program, channel, "--config", str(config)],
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "HOME": str(home), "STATE_DIRECTORY": str(home)},
        )
    try:
        ends_s = time.monotonic() + _WITHIN_S
        while True:
            try:
                with LiteGrip(channel):
                    break
            except ConnectError:
                if process.poll() is not None or time.monotonic() > ends_s:
                    raise
                time.sleep(0.05)
        yield channel
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def simulated(channel: str, method: str, **params: Any) -> dict[str, Any]:
    """Change the world around a gripper's jaws."""
    with LiteGrip(channel) as gripper:
        return gripper._session.connection.call(method, params)


def move(channel: str, openness: float) -> None:
    """Move jaws, which hold there disabled: friction keeps them."""
    with LiteGrip(channel) as gripper:
        gripper.enable()
        gripper.goto_openness(openness)
