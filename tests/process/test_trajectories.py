"""Trajectories over real sockets, with a real helper process and real files."""

import os
import signal
from pathlib import Path
from typing import Any

from tests.process.daemon_process import Client, DaemonProcess, daemon
from tests.trajectories import fetched, lgt, pieces, points_of, sampled, send, swing, uploaded

PATH = sampled(swing(0.5, 0.05, 1.0), 1.0)


def recorded(client: Client, **params: object) -> dict[str, Any]:
    """Record by hand until 20 samples are there, and end it."""
    client.despite_silence("trajectory.record_start", rate_hz=100)
    status: dict[str, Any] = {"active": True, "samples": 0}
    while status["active"] and status["samples"] < 20:
        status = client.result("trajectory.status")
    return client.result("trajectory.record_stop", allow_partial=True, **params)


def test_a_recording_survives_a_restart_and_replays(tmp_path: Path) -> None:
    config = tmp_path / "patient.toml"
    config.write_text(
        '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n',
        encoding="utf-8",
    )
    arguments = (f"sim-{os.getpid()}", "--config", str(config))
    with daemon(tmp_path, *arguments) as running, running.connect() as client:
        client.enabled()
        answer = recorded(client, name="pick")
        assert answer["path"] == str(tmp_path / "trajectories" / "pick.lgt")
        content = fetched(client, name="pick")
        assert (tmp_path / "trajectories" / "pick.lgt").read_bytes() == content
    with daemon(tmp_path, *arguments) as running, running.connect() as client:
        client.enabled()
        listed = client.result("trajectory.list")["trajectories"]
        assert [one["name"] for one in listed] == ["pick"]
        assert len(points_of(fetched(client, name="pick"))) == listed[0]["samples"]
        assert client.despite_silence("trajectory.play", name="pick", speed=0.5)["ok"]
        assert client.result("trajectory.delete", name="pick")["deleted"]
        assert client.refusal("trajectory.play", name="pick") == "unknown_trajectory"


def test_an_upload_is_played_and_gone_with_its_connection(
    simulated: DaemonProcess, tmp_path: Path
) -> None:
    with simulated.connect() as client:
        client.enabled()
        number = uploaded(client, PATH)
        assert client.despite_silence("trajectory.play", upload=number)["ok"]
        with simulated.connect() as other:
            assert other.refusal("trajectory.get", upload=number) == "unknown_trajectory"
            mine = uploaded(other, PATH)
            assert fetched(other, upload=mine) == lgt(PATH)
        again = uploaded(client, [*PATH, (2.0, 0.5)])
        assert client.refusal("trajectory.get", upload=mine) == "unknown_trajectory"
        assert fetched(client, upload=again)
        assert not (tmp_path / "trajectories").exists()


def test_a_helper_that_dies_takes_its_uploads_and_nothing_else(
    simulated: DaemonProcess, tmp_path: Path
) -> None:
    with simulated.connect() as client:
        client.enabled()
        send(client, lgt(PATH), name="pick")
        number = uploaded(client, [*PATH, (2.0, 0.5)])
        first, *_ = pieces(lgt(sampled(swing(), 30.0)))
        client.result("trajectory.put", **first)
        os.kill(client.result("health")["helper"]["pid"], signal.SIGKILL)
        client.until_health(lambda health: bool(health["helper"]["deaths"] == 1))
        client.until_health(lambda health: health["helper"]["pid"] is not None)
        assert client.refusal("trajectory.play", upload=number) == "unknown_trajectory"
        assert client.refusal("trajectory.put", **{**first, "offset": 8192}) == "out_of_limits"
        assert client.despite_silence("trajectory.play", name="pick")["ok"]
