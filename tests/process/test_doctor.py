"""litegripctl doctor, health and metrics on a real daemon with the simulated gripper."""

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from litegrip_client.ctl import metrics
from litegrip_client.ctl.doctor import gather
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, litegripctl

NO_METRICS = {
    "control.cpus",
    "helper.pid",
    "spawner.pid",
    "bus.error",
    "teleop.pid",
    "teleop.link",
    "teleop.reach",
    "teleop.unreached",
}
"""Figures of health that are no quantities."""


def findings(running: DaemonProcess) -> dict[str, dict[str, Any]]:
    code, out = litegripctl(running, "doctor", "--json")
    found = {row["check"]: row for row in json.loads(out)["findings"]}
    assert code == (1 if any(row["level"] == "error" for row in found.values()) else 0)
    return found


def levels(running: DaemonProcess) -> dict[str, str]:
    return {name: row["level"] for name, row in findings(running).items()}


def test_doctor(own: DaemonProcess) -> None:
    with own.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        found = levels(own)
        # The other machine's device is not here; the way to it is.
        way = "protection" if own.remote_as else "device"
        well = ("daemon", "version", "sockets", "bus", "motor", "other-master", way)
        registers = ("control-mode", "can-br", "ids", "watchdog", "ranges")
        assert {name: found[name] for name in well + registers} == dict.fromkeys(
            well + registers, "ok"
        )
        assert found["calibration"] == "warning"  # a template
        assert "link" not in found
        assert "channel" not in found
        client.result("calibration.save")  # which measures nothing
        found = levels(own)
        assert (found["calibration"], found["channel"]) == ("warning", "ok")
        old = {"zero_position_rad": 0.1, "max_position_rad": -1.5, "rad_to_mm": 75.0}
        client.result("calibration.load", content=old)
        client.result("calibration.save")
        client.until(lambda state: bool(state["scale_doubt"] == "superseded"))
        row = findings(own)["calibration"]
        assert row["level"] == "warning"
        assert "which took the travel for 120 mm" in row["text"]
        assert row["command"].endswith(" calibration rescale")  # and that alone corrects it
        assert litegripctl(own, "calibration", "rescale")[0] == 0
        client.until(lambda state: bool(state["scale_doubt"] is None))
        found = levels(own)
        assert (found["calibration"], found["channel"]) == ("ok", "ok")
        client.result("stop", level="disable")
        assert levels(own)["motor"] == "ok"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("[buss]\n", "unknown table [buss]"),
        ('[bus]\ninterface = "slcan"\nchannel = "/dev/ttyACM9"\n', None),
    ],
)
def test_a_configuration_is_checked_by_the_daemons_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str, told: str | None
) -> None:
    program, file = tmp_path / "litegripd", tmp_path / "can0.toml"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m litegripd.app.main "$@"\n')
    program.chmod(0o755)
    file.write_text(content, encoding="utf-8")
    monkeypatch.setattr(gather, "DIRECTORY", tmp_path)
    monkeypatch.setattr(gather, "CHECK_WITHIN_S", DEADLINE_S)
    monkeypatch.setattr(gather, "program_of", lambda _name: str(program))
    found = gather.configuration_file("can0")
    assert found is not None
    assert found.unchecked is None
    if told is None:
        assert found.content is not None
        assert found.content["file"] == str(file)
        assert found.content["bus"] == {
            "interface": "slcan",
            "channel": "/dev/ttyACM9",
            "bitrate": 1_000_000,
        }
    else:
        assert str(found.error).startswith(f"{file}: ")
        assert told in str(found.error)


def test_health_and_metrics(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.until_health(lambda health: bool(health["control"]["lateness"]["p99_us"]))
        code, out = litegripctl(simulated, "health")
        verdict = out.splitlines()[0]
        assert (verdict, code) in (("verdict: ok", 0), ("verdict: degraded", 1))
        health, hello = client.result("health"), client.result("hello")
        code, out = litegripctl(simulated, "metrics")
    assert code == 0
    families = {family.name: family for family in text_string_to_metric_families(out)}
    ticks = families["litegripd_ticks"].samples[0]
    assert ticks.labels == {"channel": hello["channel"]}
    assert ticks.value >= health["control"]["ticks"]
    quantiles = [s.labels["quantile"] for s in families["litegripd_tick_lateness_seconds"].samples]
    assert quantiles == ["0.5", "0.99", "0.999"]


def test_every_figure_of_health_is_a_metric(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        health = client.result("health")
    known = {row.path for row in metrics.ROWS} | {"verdict", "reasons", "notes"}
    known |= {"bus.state", "bus.ifindex"}  # a word, and a name by number
    if health["remote"] is None:  # not through a portal
        known = {path for path in known if not path.startswith("remote.")} | {"remote"}
    for path in metrics.SUMMARIES:
        known |= {f"{path}.{name}" for name in ("p50_us", "p99_us", "p99_9_us")}
    assert set(paths(health)) - NO_METRICS == known


def paths(data: Mapping[str, Any], before: str = "") -> Iterator[str]:
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield from paths(value, f"{before}{name}.")
        else:
            yield f"{before}{name}"
