"""What a daemon keeps over its end: the measured calibration and the kept configuration."""

import json
from pathlib import Path

import pytest

from tests.process.by_portal import Met
from tests.process.daemon_process import BY_GATEWAY, daemon

CHANNEL = "sim0"


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """Configure a simulated gripper of the reverse mount, with a patient watchdog."""
    path = tmp_path / "sim0.toml"
    path.write_text(
        '[bus]\ninterface = "litegrip_sim"\nmount = "reverse"\nwatchdog_s = 0.4\n'
        f'[gripper]\nmount = "reverse"\n{BY_GATEWAY}',
        encoding="utf-8",
    )
    return path


def test_a_measured_calibration_and_a_kept_configuration_survive_a_restart(
    met: Met, tmp_path: Path, config: Path
) -> None:
    state = tmp_path / "state"
    arguments = (CHANNEL, "--config", str(config))
    with daemon(state, *arguments) as running, met(running), running.connect() as client:
        nominal = client.result("calibration.get")
        assert str(nominal["file"]).endswith("reverse.json")
        client.enabled()
        measured = client.despite_silence("calibration.zero")
        assert (measured["ok"], measured["outcome"]) == (True, "measured"), measured
        assert measured["path"] == str(state / "sim0_calibration.json")
        kept = client.result("config.set", config={"force_n": 7.5, "speed_mm_s": 40}, keep=True)
        assert kept["kept"]
    content = json.loads((state / "sim0_calibration.json").read_text(encoding="utf-8"))
    assert content == measured["content"]
    assert content["channel"] == CHANNEL
    with daemon(state, *arguments) as running, met(running), running.connect() as client:
        again = client.result("calibration.get")
        assert again["file"] == measured["path"]
        assert again["mount"] == "reverse"
        assert again["rad_to_mm"] == measured["rad_to_mm"]
        settings = client.result("config.get")
        assert (settings["kept"], settings["config"]["force_n"]) == (True, 7.5)
        client.enabled()
        assert client.despite_silence("motion.close")["outcome"] == "pressed_home"


def test_an_unreadable_file_of_its_own_stops_motions_and_not_the_daemon(
    met: Met, tmp_path: Path, config: Path
) -> None:
    state = tmp_path / "state"
    state.mkdir()
    (state / "sim0_calibration.json").write_text("{", encoding="utf-8")
    (state / "sim0_motion.json").write_text('{"channel": "sim0"}', encoding="utf-8")
    with (
        daemon(state, CHANNEL, "--config", str(config)) as running,
        met(running),
        running.connect() as client,
    ):
        client.until(lambda seen: bool(seen["motor"] == "disabled"))
        assert client.despite_silence("motor.enable")["ok"]
        error = client.call("motion.open")["error"]
        assert error["data"]["reason"] == "calibration_unreadable"
        assert "sim0_calibration.json" in error["message"]
        assert not client.result("config.get")["kept"]
        loaded = client.result("calibration.load", template="reverse")
        assert (loaded["loaded"], loaded["mount"]) == (True, "reverse")
        assert client.despite_silence("motion.open")["ok"]
        saved = client.result("calibration.save")
        assert saved["path"] == str(state / "sim0_calibration.json")
    assert "sim0_motion.json" in running.log
    assert calibration_is_readable(state / "sim0_calibration.json")


def calibration_is_readable(path: Path) -> bool:
    content = json.loads(path.read_text(encoding="utf-8"))
    return bool(content["zero_position_rad"] < content["max_position_rad"])
