"""From radians to millimetres, openness and newtons, on both mounts."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.gripper import Geometry

BENCH = Geometry(0.104334, -1.513123, 74.19)
limits = st.floats(-12.5, 12.5)


def test_the_bench_unit() -> None:
    assert BENCH.travel_rad == pytest.approx(1.617457)
    assert BENCH.travel_mm == pytest.approx(120.0, abs=0.01)
    assert (BENCH.close_sign, BENCH.mount) == (1, "normal")
    assert BENCH.opening_mm(BENCH.closed_rad) == 0.0
    assert BENCH.opening_mm(BENCH.open_rad) == pytest.approx(120.0, abs=0.01)
    assert BENCH.force_n(2.0) == pytest.approx(20.0)
    assert BENCH.to_rad(74.19) == pytest.approx(1.0)


def test_the_reverse_mount_mirrors_the_normal_one() -> None:
    mirrored = Geometry(-0.104334, 1.513123, 74.19)
    assert (mirrored.close_sign, mirrored.mount) == (-1, "reverse")
    for position_rad in (-1.0, 0.0, 0.1, 2.0):
        assert mirrored.opening_mm(-position_rad) == BENCH.opening_mm(position_rad)
        assert mirrored.openness(-position_rad) == BENCH.openness(position_rad)
    assert mirrored.force_n(-2.0) == BENCH.force_n(2.0)


@given(limits, limits, st.floats(1.0, 1000.0), limits)
def test_openness_is_a_share_and_opening_grows_towards_open(
    closed_rad: float, open_rad: float, rad_to_mm: float, position_rad: float
) -> None:
    if abs(closed_rad - open_rad) < 0.001:
        with pytest.raises(ValueError, match=r"equal|travel"):
            Geometry(closed_rad, open_rad, rad_to_mm)
        return
    geometry = Geometry(closed_rad, open_rad, rad_to_mm)
    assert 0.0 <= geometry.openness(position_rad) <= 1.0
    assert geometry.openness(closed_rad) == 0.0
    assert geometry.openness(open_rad) == pytest.approx(1.0)
    further = position_rad - 0.1 * geometry.close_sign
    assert geometry.opening_mm(further) > geometry.opening_mm(position_rad)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_openness_refuses_what_is_not_finite_before_it_clamps(bad: float) -> None:
    with pytest.raises(ValueError, match="position"):
        BENCH.openness(bad)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ((math.nan, 0.0, 74.8), "finite"),
        ((0.0, math.inf, 74.8), "finite"),
        ((0.0, 1.0, math.nan), "finite"),
        ((0.5, 0.5, 74.8), "equal"),
        ((0.0, 1.0, 0.0), "above 0"),
        ((0.0, 1.0, -74.8), "above 0"),
        ((1e308, -1e308, 74.8), "beyond"),
        ((0.0, 1e-300, 74.8), "travel"),
        ((0.0, 1.0, 5e-324), "rad_to_mm"),
        ((0.0, 1.0, 1e300), "rad_to_mm"),
    ],
)
def test_what_makes_no_geometry(values: tuple[float, float, float], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        Geometry(*values)
