"""Another program commands our motor while a daemon runs: what its configuration makes of that."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from litegripd.model.gripper import DM4310
from litegripd.model.motor import MitCommand
from litegripd.motor import codec
from tests.process.daemon_process import SLCAN, Client, configured
from tests.sim.simulator_process import SimulatorProcess, simulator

NO_GAINS = codec.encode_command(MitCommand(0.0, 0.0, 0.0, 0.0, 0.0), DM4310.ranges)
FOREIGN = f"inject 008 {NO_GAINS.hex()}"


@contextlib.contextmanager
def at_work(folder: Path, more: str = "") -> Iterator[tuple[SimulatorProcess, Client]]:
    """Run a daemon with this in its configuration whose motor is enabled, alone on the bus."""
    with simulator("--pty") as adapter:
        config = SLCAN.format(channel=adapter.first_line) + more
        own = configured(folder, f"second{os.getpid()}", config)
        with own as running, running.connect() as client:
            client.enabled()
            assert complaints(client.result("health")) == []
            yield adapter, client


def complaints(health: dict[str, Any]) -> list[str]:
    """Return what health says of another program."""
    return [reason for reason in health["reasons"] if "another program" in reason]


def told(client: Client, frames: int) -> dict[str, Any]:
    """Wait until health tells of so many frames; return it."""
    text = f"another program commands the motor ({frames} frames so far)"
    return client.until_health(
        lambda health: any(reason.startswith(text) for reason in complaints(health))
    )


def test_motions_are_refused_unless_configured_otherwise(tmp_path: Path) -> None:
    with at_work(tmp_path) as (adapter, client):
        adapter.write(FOREIGN, FOREIGN)
        verdict = told(client, 2)["verdict"]
        assert verdict == "down", "a gripper that refuses motions cannot be used"
        error = client.call("motion.open", wait=False)["error"]
        assert error["data"]["reason"] == "second_master", error
        assert error["data"]["frames"] == 2
        assert "another program commands the motor on the same bus" in error["message"]
        client.until_health(lambda health: complaints(health) == [])
        assert client.despite_silence("motion.open", wait=False)["job"]


def test_where_it_is_tolerated_motions_run_and_health_tells(tmp_path: Path) -> None:
    with at_work(tmp_path, '[motor]\nsecond_master = "tolerate"\n') as (adapter, client):
        adapter.write(FOREIGN)
        health, frames = told(client, 1), 1
        while health["verdict"] == "down" and frames < 5:
            # A simulator that a busy machine has kept off the processor: down for that reason.
            assert health["reasons"][0] not in complaints(health), health
            client.despite_silence("motor.enable")
            adapter.write(FOREIGN)
            frames += 1
            health = told(client, frames)
        assert health["verdict"] == "degraded", f"a gripper that moves can be used: {health}"
        assert 'which second_master = "tolerate" lets it do' in complaints(health)[0]
        assert client.despite_silence("motion.open", wait=False)["job"]
        adapter.write(FOREIGN)
        told(client, frames + 1)
