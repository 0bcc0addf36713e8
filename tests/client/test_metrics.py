"""litegripctl metrics: OpenMetrics text, read back by the parsers of prometheus_client."""

import json
import re
from collections.abc import Callable
from typing import Any

from prometheus_client.metrics_core import Metric
from prometheus_client.openmetrics.parser import text_string_to_metric_families as open_metrics
from prometheus_client.parser import text_string_to_metric_families as classic

from litegrip_client import __version__
from litegrip_client.ctl import metrics
from tests.client.ctl_terminal import ROOT
from tests.client.helpers import Ctl
from tests.client.rig import Heard

HEALTH: dict[str, Any] = {
    "verdict": "degraded",
    "reasons": ["no calibration is loaded"],
    "uptime_s": 12.5,
    "control": {
        "ticks": 2500,
        "lateness": {"p50_us": 60.0, "p99_us": 250.0, "p99_9_us": None, "worst_us": 900.0},
        "cpu_share": 0.25,
        "memory_locked": True,
        "resident_mb": 34.5,
        "cpus": [0, 1],
    },
    "bus": {"state": "down", "error": "Network is down", "load": 0.0, "sent": 7},
    "heat": {"coil_c": 25.5, "time_to_limit_s": None},
}
CHANNEL = {"channel": "can0"}
SAMPLES: list[tuple[str, dict[str, str], float]] = [
    ("litegripd_build_info", {"version": "0.1.0"}, 1.0),
    ("litegripd_verdict", {"verdict": "ok"}, 0.0),
    ("litegripd_verdict", {"verdict": "degraded"}, 1.0),
    ("litegripd_verdict", {"verdict": "down"}, 0.0),
    ("litegripd_bus_up", {}, 0.0),
    ("litegripd_uptime_seconds", {}, 12.5),
    ("litegripd_ticks_total", {}, 2500.0),
    ("litegripd_tick_lateness_max_seconds", {}, 0.0009),
    ("litegripd_cpu_ratio", {}, 0.25),
    ("litegripd_memory_locked", {}, 1.0),
    ("litegripd_resident_memory_bytes", {}, 34.5e6),
    ("litegripd_bus_load_ratio", {}, 0.0),
    ("litegripd_bus_frames_sent_total", {}, 7.0),
    ("litegripd_coil_temperature_celsius", {}, 25.5),
    ("litegripd_tick_lateness_seconds", {"quantile": "0.5"}, 60e-6),
    ("litegripd_tick_lateness_seconds", {"quantile": "0.99"}, 250e-6),
]


def families(health: dict[str, Any]) -> list[Metric]:
    return list(open_metrics(metrics.text(health, "openmetrics", channel="can0", version="0.1.0")))


def test_every_figure_that_is_known_is_a_sample_and_no_other() -> None:
    found = [
        (sample.name, sample.labels, round(sample.value, 9))
        for family in families(HEALTH)
        for sample in family.samples
    ]
    assert found == [(name, {**CHANNEL, **labels}, value) for name, labels, value in SAMPLES]


def test_kinds_and_units() -> None:
    found = {family.name: (family.type, family.unit) for family in families(HEALTH)}
    assert found["litegripd_ticks"] == ("counter", "")
    assert found["litegripd_uptime_seconds"] == ("gauge", "seconds")
    assert found["litegripd_tick_lateness_seconds"] == ("summary", "seconds")
    assert found["litegripd_resident_memory_bytes"] == ("gauge", "bytes")


def test_names_follow_the_conventions() -> None:
    names = [row.name for row in metrics.ROWS] + [name for name, _ in metrics.SUMMARIES.values()]
    assert len(names) == len(set(names))
    for row in metrics.ROWS:
        assert re.fullmatch(r"[a-z][a-z_]*[a-z]", row.name)
        assert row.name.endswith(row.unit)
        assert not row.name.endswith(("_total", "_us", "_ms", "_mb", "_percent"))
        assert row.help.endswith(".")


def test_a_daemon_that_is_still_starting_has_a_verdict() -> None:
    found = families({"verdict": "down", "reasons": ["the daemon is still starting"]})
    assert [family.name for family in found] == ["litegripd_build_info", "litegripd_verdict"]


def test_a_label_may_hold_anything() -> None:
    text = metrics.text(HEALTH, "openmetrics", channel='a"b\\c\nd', version="1")
    assert {sample.labels["channel"] for family in open_metrics(text) for sample in family.samples}
    first = next(iter(open_metrics(text)))
    assert first.samples[0].labels["channel"] == 'a"b\\c\nd'


def test_the_older_format_says_of_each_sample_what_it_is_and_means() -> None:
    """For node_exporter's textfile collector, which knows a counter by its whole name only."""
    text = metrics.text(HEALTH, "text", channel="can0", version="0.1.0")
    found = [sample.name for family in classic(text) for sample in family.samples]
    assert found == [name for name, _, _ in SAMPLES]
    for about in ("HELP", "TYPE"):
        told = re.findall(rf"^# {about} (\S+) .", text, re.MULTILINE)
        assert told == list(dict.fromkeys(found))
    kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", text, re.MULTILINE))
    assert set(kinds.values()) == {"counter", "gauge", "summary"}
    assert all((kind == "counter") == name.endswith("_total") for name, kind in kinds.items())


def test_the_dashboard_asks_for_metrics_that_there_are() -> None:
    whole = (ROOT / "etc/grafana-dashboard.json").read_text(encoding="utf-8")
    dashboard = json.loads(whole)
    asked = set(re.findall(r"\blitegripd_\w+", whole))
    counters = {f"litegripd_{row.name}_total" for row in metrics.ROWS if row.kind == "counter"}
    gauges = {f"litegripd_{row.name}" for row in metrics.ROWS if row.kind == "gauge"}
    others = {f"litegripd_{name}" for name, _ in metrics.SUMMARIES.values()}
    assert asked <= counters | gauges | others | {"litegripd_verdict", "litegripd_bus_up"}
    for panel in dashboard["panels"]:
        for target in panel["targets"]:
            is_rate = target["expr"].startswith("rate(")
            assert is_rate == any(f"{name}{{" in target["expr"] for name in counters)
            assert '{channel=~"$channel"' in target["expr"]


def test_the_command(heard: Heard, litegripctl: Ctl) -> None:
    heard.instead["health"] = HEALTH
    code, out, err = litegripctl("metrics")
    assert (code, err) == (0, "")
    assert out == metrics.text(HEALTH, "openmetrics", channel="can0", version=__version__)
    assert out.endswith("\n# EOF\n")
    older = litegripctl("metrics", "--format", "text")[1]
    assert older == metrics.text(HEALTH, "text", channel="can0", version=__version__)
    data = json.loads(litegripctl("metrics", "--json")[1])
    assert data["text"] == out
    assert data["format"].startswith("application/openmetrics-text")


def test_without_the_library_a_line_says_what_to_install(
    heard: Heard, litegripctl: Ctl, hide: Callable[[str, str], None]
) -> None:
    heard.instead["health"] = HEALTH
    hide("prometheus_client", "litegrip_client.ctl.metrics")
    code, out, err = litegripctl("metrics")
    assert (code, out) == (4, "")
    assert err.startswith("litegripctl: metrics needs the library prometheus_client")
    assert err.endswith("-m pip install prometheus_client\n")
    assert "health" not in heard.methods()
    assert litegripctl("health")[0] == 1
