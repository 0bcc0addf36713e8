"""The figures about time: percentiles, and the window of recent ones."""

import pytest

from litegripd.io.meters import LatenessMeter, RecentLateness


def test_percentiles_are_upper_edges_of_ten_microseconds_and_never_above_the_worst() -> None:
    meter = LatenessMeter()
    assert meter.percentiles_s((0.5,)) == [None]
    for microseconds in range(1, 1001):
        meter.add(microseconds * 1e-6)
    p50, p99, worst = meter.percentiles_s((0.5, 0.99, 1.0))
    assert p50 == pytest.approx(500e-6, abs=11e-6)
    assert p99 == pytest.approx(990e-6, abs=11e-6)
    assert worst == meter.worst_s == pytest.approx(1e-3)


def test_what_is_out_of_range_counts_as_an_end_and_the_worst_is_exact() -> None:
    meter = LatenessMeter()
    meter.add(-1.0)
    meter.add(0.5)
    assert meter.percentiles_s((0.5, 1.0)) == [pytest.approx(10e-6), pytest.approx(10e-3)]
    assert meter.summary_us()["worst_us"] == 500_000.0


def test_what_was_late_long_ago_is_forgotten() -> None:
    recent = RecentLateness(window_s=30.0)
    assert recent.p99_s() is None
    recent.add(0.0, 5e-3)
    for second in range(1, 31):
        recent.add(float(second), 20e-6)
    assert recent.p99_s() == pytest.approx(5e-3, abs=1e-5)
    for second in range(31, 62):
        recent.add(float(second), 20e-6)
    late_s = recent.p99_s()
    assert late_s is not None
    assert late_s <= 30e-6
