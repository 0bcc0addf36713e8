"""litegripctl doctor, health and metrics on a real daemon with the simulated gripper."""

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from prometheus_client.openmetrics.parser import text_string_to_metric_families

from litegrip_client import metrics
from tests.process.daemon_process import DEADLINE_S, DaemonProcess

NO_METRICS = {"control.cpus", "helper.pid", "bus.error", "teleop.pid", "teleop.link"}
"""Figures of health that are no quantities."""


def litegripctl(running: DaemonProcess, *arguments: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "litegrip_client.ctl", "--socket", str(running.socket_path)]
    done = subprocess.run(
        [*command, *arguments], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert done.stderr == ""
    return done.returncode, done.stdout


def levels(running: DaemonProcess) -> dict[str, str]:
    code, out = litegripctl(running, "doctor", "--json")
    found = {row["check"]: row["level"] for row in json.loads(out)["findings"]}
    assert code == (1 if "error" in found.values() else 0)
    return found


def test_doctor(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        found = levels(simulated)
        well = ("device", "daemon", "version", "sockets", "bus", "motor", "other-master")
        registers = ("control-mode", "can-br", "ids", "watchdog", "ranges")
        assert {name: found[name] for name in well + registers} == dict.fromkeys(
            well + registers, "ok"
        )
        assert found["calibration"] == "warning"  # a template
        assert "link" not in found
        assert "channel" not in found
        client.result("calibration.save")  # which measures nothing
        found = levels(simulated)
        assert (found["calibration"], found["channel"]) == ("warning", "ok")
        measured = {"zero_position_rad": 0.1, "max_position_rad": -1.5, "rad_to_mm": 75.0}
        client.result("calibration.load", content=measured)
        client.result("calibration.save")
        found = levels(simulated)
        assert (found["calibration"], found["channel"]) == ("ok", "ok")
        client.result("stop", level="disable")
        assert levels(simulated)["motor"] == "ok"


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
    known = {row.path for row in metrics.ROWS} | {"bus.state", "verdict", "reasons"}
    for path in metrics.SUMMARIES:
        known |= {f"{path}.{name}" for name in ("p50_us", "p99_us", "p99_9_us")}
    assert set(paths(health)) - NO_METRICS == known


def paths(data: Mapping[str, Any], before: str = "") -> Iterator[str]:
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield from paths(value, f"{before}{name}.")
        else:
            yield f"{before}{name}"
