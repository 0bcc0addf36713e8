"""No scale that a file may have moves the jaws faster than the bound, on two kinds of plant."""

import pytest

from litegripd.model.gripper import FASTEST_RAD_S, STROKE_MM
from tests.plants.scales import SCALES, WORLDS, agreeing_stroke_mm, run

OVERSHOOT = 1.15
"""Jaws that gain their speed overshoot it; a stop that springs back throws them."""


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("scale", SCALES)
def test_a_scale_is_refused_or_the_motor_stays_below_its_bound(name: str, scale: float) -> None:
    for stroke_mm in (STROKE_MM, agreeing_stroke_mm(scale)):
        ran = run(name, scale, stroke_mm)
        if ran.refused is None:
            assert ran.fastest_rad_s is not None
            assert 0.0 < ran.fastest_rad_s <= OVERSHOOT * FASTEST_RAD_S
        else:
            assert ran.refused == "calibration_unreadable"


@pytest.mark.parametrize("name", WORLDS)
def test_with_the_configured_stroke_only_scales_near_the_true_one_are_taken(name: str) -> None:
    taken = [scale for scale in SCALES if run(name, scale, STROKE_MM).refused is None]
    assert taken == [45.0, 52.69]
