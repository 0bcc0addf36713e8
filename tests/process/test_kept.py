"""What a daemon keeps over its end: the measured calibration and the kept configuration."""

import json
import os
from pathlib import Path

import pytest

from litegripd.model.calibration import SUPERSEDED
from litegripd.model.gripper import STROKE_MM
from tests.process.by_portal import Met
from tests.process.daemon_process import BY_GATEWAY, daemon

CHANNEL = f"kept{os.getpid()}"
CALIBRATION = f"{CHANNEL}_calibration.json"


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
        assert measured["path"] == str(state / CALIBRATION)
        kept = client.result("config.set", config={"force_n": 7.5, "speed_mm_s": 40}, keep=True)
        assert kept["kept"]
    content = json.loads((state / CALIBRATION).read_text(encoding="utf-8"))
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


def test_what_an_earlier_version_has_left_is_taken_as_far_as_it_goes_and_told(
    tmp_path: Path, config: Path
) -> None:
    """Its stroke, its calibration on 120 mm, and a speed that it allowed."""
    state = tmp_path / "state"
    state.mkdir()
    old = SUPERSEDED[1]
    limits = {"zero_position_rad": old.closed_rad, "max_position_rad": old.open_rad}
    calibration = {"channel": CHANNEL, **limits, "rad_to_mm": old.rad_to_mm}
    motion = {"channel": CHANNEL, "config": {"speed_mm_s": 300.0, "force_n": 7.5}}
    for kind, content in (("calibration", calibration), ("motion", motion)):
        (state / f"{CHANNEL}_{kind}.json").write_text(json.dumps(content), encoding="utf-8")
    config.write_text(
        config.read_text(encoding="utf-8").replace("[gripper]\n", "[gripper]\nstroke_mm = 120.0\n"),
        encoding="utf-8",
    )
    with daemon(state, CHANNEL, "--config", str(config)) as running, running.connect() as client:
        client.until(lambda seen: bool(seen["motor"] == "disabled" and seen["calibrated"]))
        told = client.result("info.get")
        assert told["gripper"]["stroke_mm"] == STROKE_MM
        assert told["configuration"]["gripper"]["stroke_mm"] == 120.0
        assert client.result("state.get")["scale_doubt"] == "superseded"
        health = client.result("health")
        assert any("as earlier versions did" in reason for reason in health["reasons"])
        settings = client.result("config.get")["config"]
        assert (settings["speed_mm_s"], settings["force_n"]) == (50.0, 7.5)
        rescaled = client.result("calibration.rescale")
        assert rescaled["travel_mm"] == pytest.approx(STROKE_MM + 1.0)
        assert client.result("calibration.save")["path"] == str(state / CALIBRATION)
    for words in ("stroke_mm = 120 in", "as earlier versions did", "speed_mm_s is 300,"):
        assert sum(words in line for line in running.log.splitlines()) == 1
    content = json.loads((state / CALIBRATION).read_text(encoding="utf-8"))
    assert content["rad_to_mm"] == rescaled["rad_to_mm"]


def test_an_unreadable_file_of_its_own_stops_motions_and_not_the_daemon(
    met: Met, tmp_path: Path, config: Path
) -> None:
    state = tmp_path / "state"
    state.mkdir()
    (state / CALIBRATION).write_text("{", encoding="utf-8")
    (state / f"{CHANNEL}_motion.json").write_text(f'{{"channel": "{CHANNEL}"}}', encoding="utf-8")
    with (
        daemon(state, CHANNEL, "--config", str(config)) as running,
        met(running),
        running.connect() as client,
    ):
        client.until(lambda seen: bool(seen["motor"] == "disabled"))
        assert client.despite_silence("motor.enable")["ok"]
        error = client.call("motion.open")["error"]
        assert error["data"]["reason"] == "calibration_unreadable"
        assert CALIBRATION in error["message"]
        assert not client.result("config.get")["kept"]
        loaded = client.result("calibration.load", template="reverse")
        assert (loaded["loaded"], loaded["mount"]) == (True, "reverse")
        assert client.despite_silence("motion.open")["ok"]
        saved = client.result("calibration.save")
        assert saved["path"] == str(state / CALIBRATION)
    assert f"{CHANNEL}_motion.json" in running.log
    assert calibration_is_readable(state / CALIBRATION)


def calibration_is_readable(path: Path) -> bool:
    content = json.loads(path.read_text(encoding="utf-8"))
    return bool(content["zero_position_rad"] < content["max_position_rad"])
