"""Every command of litegripctl with --json on a real daemon: a JSON text in each line."""

import json
from pathlib import Path

import pytest

from litegrip_client.ctl.main import main
from tests.client.ctl_commands import LINES
from tests.process.daemon_process import DaemonProcess

CODES = {
    "cancel 1": {1},  # it has ended
    "health": {0, 1},  # a busy machine makes a tick late
    "doctor": {0, 1},  # as the machine is
    "calibration manual": {2},  # it asks at a terminal
    "trajectories keep another": {4},  # there is none that could not be kept
    "fleet --config no-such-fleet.toml": {2},  # there is none
    "grasp --force 10": {1},  # there is nothing between the jaws
}
LETTING_GO = ("motor_silent", "motor_fault", "not_enabled")
"""What a machine brings about that stops the daemon for longer than the motor waits."""


def test_every_command(
    simulated: DaemonProcess,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path / "own"))
    monkeypatch.chdir(tmp_path)  # a picture is written where the caller is
    monkeypatch.delenv("LITEGRIP_CHANNEL", raising=False)
    with simulated.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
    for line in LINES:
        if line.startswith("restart"):
            continue  # the successor would be nobody's child here
        code = main(["--socket", str(simulated.socket_path), "--json", *line.split()])
        shown = [json.loads(text) for text in capsys.readouterr().out.splitlines()]
        assert len(shown) == (2 if line.startswith("watch") else 1), line
        if code not in CODES.get(line, {0}):
            reason = (shown[0].get("error") or {"data": {"reason": None}})["data"]["reason"]
            assert reason in LETTING_GO, (line, code, shown)
            main(["--socket", str(simulated.socket_path), "enable"])
            capsys.readouterr()
