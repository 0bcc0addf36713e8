"""The figures of `health` as OpenMetrics text or Prometheus' own, for what reads these formats.

The one module of the client that needs more than the standard library: `prometheus_client`, of
the extra `metrics`. Nobody imports it but the command that prints the text. The table below is the
one place that knows names and units; it asks nobody for figures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from prometheus_client import CollectorRegistry
from prometheus_client import exposition as prometheus
from prometheus_client.metrics_core import Metric
from prometheus_client.openmetrics import exposition as openmetrics
from prometheus_client.registry import Collector

from litegrip_client.values.results import USABLE_BUS

FORMATS = {"openmetrics": openmetrics, "text": prometheus}
"""By the name of a format: what writes it, as `generate_latest`, with `CONTENT_TYPE_LATEST`."""

VERDICTS = ("ok", "degraded", "down")

_PREFIX = "litegripd"
_QUANTILES = {"p50_us": "0.5", "p99_us": "0.99", "p99_9_us": "0.999"}
_MICRO = 1e-6
_SCALES = {"us": _MICRO, "mb": 1e6}
"""By the ending of a path: what makes its value one of the metric's base unit."""
_UNITS = ("seconds", "hertz", "ratio", "bytes", "celsius", "newton_meters")
"""Base units, with which the names of metrics end."""

Kind: TypeAlias = Literal["counter", "gauge"]


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: where `health` has it, and its name, kind and meaning as a metric."""

    path: str
    name: str
    kind: Kind
    help: str

    @property
    def unit(self) -> str:
        """The base unit with which the name ends, if any."""
        return next((unit for unit in _UNITS if self.name.endswith(f"_{unit}")), "")

    @property
    def scale(self) -> float:
        """What the value of `health` is multiplied by."""
        return _SCALES.get(self.path.rpartition("_")[2], 1.0)


def _counter(path: str, name: str, text: str) -> Row:
    return Row(path, name, "counter", text)


def _gauge(path: str, name: str, text: str) -> Row:
    return Row(path, name, "gauge", text)


ROWS: tuple[Row, ...] = (
    _gauge("uptime_s", "uptime_seconds", "Since the daemon's start."),
    _gauge("control.rate_hz", "control_rate_hertz", "Ticks wanted a second."),
    _counter("control.ticks", "ticks", "Ticks of the control loop."),
    _counter("control.lost_ticks", "lost_ticks", "Ticks that were left out, being too late."),
    _counter("control.tick_errors", "tick_errors", "Ticks that failed by a defect."),
    _gauge("control.lateness.worst_us", "tick_lateness_max_seconds", "The latest start of a tick."),
    _gauge("control.tick_cost.worst_us", "tick_duration_max_seconds", "The longest tick."),
    _gauge("control.cpu_share", "cpu_ratio", "The control thread's share of a CPU."),
    _gauge("control.fifo_priority", "fifo_priority", "SCHED_FIFO priority, 0 for none."),
    _gauge("control.memory_locked", "memory_locked", "Whether its memory is locked."),
    _gauge(
        "control.longest_collection_us",
        "garbage_collection_max_seconds",
        "The longest run of Python's garbage collector.",
    ),
    _gauge("control.resident_mb", "resident_memory_bytes", "Resident memory."),
    _gauge("bus.load", "bus_load_ratio", "The bus's load, estimated from frames."),
    _counter("bus.sent", "bus_frames_sent", "Frames sent."),
    _counter("bus.received", "bus_frames_received", "Frames received."),
    _counter("bus.send_failures", "bus_frames_lost", "Frames that could not be sent."),
    _counter("bus.ignored", "bus_frames_ignored", "Frames of a kind that is not the motor's."),
    _counter(
        "bus.error_frames", "bus_error_frames", "Errors on the bus that the controller corrected."
    ),
    _counter("bus.errors", "bus_errors", "Errors of sending and receiving."),
    _counter("bus.reopened", "bus_reopened", "How often the bus was opened again."),
    _gauge("bus.bitrate", "bus_bitrate", "Bit rate of the network interface, bit/s."),
    _gauge(
        "bus.pump_late_us",
        "bus_pump_late_seconds",
        "The longest that a frame has lately waited for the process that drives the adapter.",
    ),
    _counter("motor.commands", "motor_commands", "Commands to the motor."),
    _counter("motor.missed_replies", "motor_missed_replies", "Ticks without the reply due."),
    _counter("motor.withheld_commands", "motor_withheld_commands", "Commands that were not sent."),
    _counter("motor.ignored_frames", "motor_ignored_frames", "Frames that nobody had asked for."),
    _counter("motor.foreign_commands", "motor_foreign_commands", "Commands of a second master."),
    _gauge("motor.foreign_active", "motor_foreign_active", "Whether it commands just now."),
    _gauge(
        "motor.in_use",
        "motor_in_use",
        "Whether anybody uses the motor, or has tried to; else its silence is no alarm.",
    ),
    _counter(
        "motor.implausible_frames", "motor_implausible_frames", "Positions that no jaw can have."
    ),
    _gauge("heat.coil_c", "coil_temperature_celsius", "The coil's temperature by the model."),
    _gauge("heat.limit_c", "coil_temperature_limit_celsius", "Where holds are limited."),
    _gauge(
        "heat.time_to_limit_s",
        "coil_time_to_limit_seconds",
        "Until the limit, with the present load; absent if never.",
    ),
    _gauge(
        "heat.allowed_nm",
        "hold_torque_allowed_newton_meters",
        "To what holds are limited; absent while they are not.",
    ),
    _gauge("rpc.clients", "rpc_clients", "Connected clients."),
    _counter("rpc.requests", "rpc_requests", "Requests."),
    _counter("rpc.refused_requests", "rpc_requests_refused", "Requests that were refused."),
    _counter("rpc.refused_connections", "rpc_connections_refused", "Connections not let in."),
    _counter("rpc.budget_exhausted", "rpc_budget_exhausted", "Periods that left requests waiting."),
    _counter("rpc.late_shares", "rpc_late_shares", "Ticks that requests ran into."),
    _gauge("spawner.is_running", "spawner_process", "Whether it runs that starts others."),
    _counter("spawner.deaths", "spawner_deaths", "Deaths of the process that starts the others."),
    _counter("helper.deaths", "helper_deaths", "Deaths of the helper process."),
    _counter("helper.refused", "helper_requests_refused", "Requests that it did not take."),
    _gauge("helper.waiting", "helper_requests_waiting", "Requests that wait for it."),
    _gauge("teleop.is_running", "teleop_link_process", "Whether the link process runs."),
    _counter("teleop.deaths", "teleop_link_deaths", "Deaths of the link process."),
    _gauge(
        "teleop.open_to_network",
        "teleop_link_open_to_network",
        "Whether anybody on the network can take part in teleoperation; absent without a link.",
    ),
    _gauge(
        "remote.insecure",
        "portal_insecure",
        "Whether the network to a gripper of another machine is unprotected; absent without one.",
    ),
    _gauge(
        "remote.certificate_expires_s",
        "portal_certificate_expiry_timestamp_seconds",
        "When the portal's certificate is over, in Unix time; absent without one.",
    ),
    _counter("log.dropped", "log_lines_dropped", "Lines of the log that were lost."),
    _gauge("log.is_stuck", "log_stuck", "Whether nobody reads the standard error."),
)

SUMMARIES = {
    "control.lateness": ("tick_lateness_seconds", "How late ticks start, since the start."),
    "control.tick_cost": ("tick_duration_seconds", "How long ticks take, since the start."),
}
"""Quantiles, each from a mapping of `health`: name and meaning."""


def text(health: Mapping[str, Any], form: str, *, channel: str, version: str) -> str:
    """Return the figures of `health` in one of `FORMATS`; what is not known is left out."""
    registry = CollectorRegistry()
    registry.register(_Figures(list(_metrics(health, channel, version))))
    exposed: bytes = FORMATS[form].generate_latest(registry)
    return exposed.decode()


class _Figures(Collector):
    """Metrics that are there already, as a registry wants them."""

    def __init__(self, metrics: list[Metric]) -> None:
        self._metrics = metrics

    def collect(self) -> list[Metric]:
        """Return the metrics."""
        return self._metrics


def _metrics(health: Mapping[str, Any], channel: str, version: str) -> Iterator[Metric]:
    labels = {"channel": channel}
    build = _new("build_info", "The daemon's version.", "gauge")
    build.add_sample(build.name, {**labels, "version": version}, 1.0)
    yield build
    verdict = _new("verdict", "The daemon's verdict on itself: 1 for the one that holds.", "gauge")
    for one in VERDICTS:
        holds = float(health.get("verdict") == one)
        verdict.add_sample(verdict.name, {**labels, "verdict": one}, holds)
    yield verdict
    state = _find(health, "bus.state")
    if state is not None:
        up = _new("bus_up", "Whether the bus can be used.", "gauge")
        up.add_sample(up.name, labels, float(state in USABLE_BUS))
        yield up
    for row in ROWS:
        value = _find(health, row.path)
        if isinstance(value, int | float):
            metric = _new(row.name, row.help, row.kind, row.unit)
            ending = "_total" if row.kind == "counter" else ""
            metric.add_sample(f"{metric.name}{ending}", labels, float(value) * row.scale)
            yield metric
    for path, (name, meaning) in SUMMARIES.items():
        yield from _summary(_find(health, path), name, meaning, labels)


def _summary(
    figures: object, name: str, meaning: str, labels: Mapping[str, str]
) -> Iterator[Metric]:
    if not isinstance(figures, Mapping):
        return
    metric = _new(name, meaning, "summary", "seconds")
    for key, quantile in _QUANTILES.items():
        if isinstance(figures.get(key), int | float):
            metric.add_sample(metric.name, {**labels, "quantile": quantile}, figures[key] * _MICRO)
    if metric.samples:
        yield metric


def _new(name: str, meaning: str, kind: str, unit: str = "") -> Metric:
    return Metric(f"{_PREFIX}_{name}", meaning, kind, unit)


def _find(health: Mapping[str, Any], path: str) -> object:
    """Return what `health` has under a dotted name, None where it has none."""
    value: object = health
    for name in path.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value
