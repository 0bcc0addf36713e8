"""A fleet on this machine: a daemon on a simulated gripper, a gateway, a router and a portal."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import SIMULATED, Client, DaemonProcess, daemon
from tests.process.fleet.fleet_process import Fleet, fleet

START_MM = 60.0
"""Where the simulated gripper's jaws are when it begins."""


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaemonProcess]:
    """One daemon for all tests of a module; each takes it as `gripper`."""
    folder = tmp_path_factory.mktemp("left")
    config = folder / "simulated.toml"
    config.write_text(SIMULATED, encoding="utf-8")
    with daemon(folder, f"left-{os.getpid()}", "--config", str(config)) as running:
        yield running


@pytest.fixture
def gripper(left: DaemonProcess) -> DaemonProcess:
    """Return the daemon as it was at its beginning: disabled, half open, with no client."""
    with left.connect() as client:
        client.until(lambda _state: len(client.result("clients.list")["clients"]) == 1)
        client.result("stop", level="disable")
        client.result("sim.reset")
        client.result("stop.clear")
        client.until(lambda state: bool(state["calibrated"]))
        client.despite_silence("motion.move", opening_mm=START_MM, speed_mm_s=140)
        disable(client)
    return left


def disable(client: Client) -> None:
    """Disable the motor, also one that a busy machine has let fall silent meanwhile."""
    methods = {"enabled": "motor.disable", "fault": "motor.clear_fault"}

    def is_disabled(state: dict[str, Any]) -> bool:
        if state["motor"] in methods:
            client.call(methods[state["motor"]])
        return bool(state["motor"] == "disabled")

    client.until(is_disabled)


@pytest.fixture
def lab(tmp_path: Path, certificates: Path, gripper: DaemonProcess) -> Iterator[Fleet]:
    with fleet(tmp_path / "fleet", certificates, {"left": gripper.socket_path}) as running:
        yield running
