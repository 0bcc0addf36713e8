"""The tunables, their ranges, and which of them do not go together."""

import math
from dataclasses import fields, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import RANGES, MotionConfig, move_conflict

CONFIG = MotionConfig()
GEOMETRY = Geometry(0.114, -1.491, 74.8)
VENDOR = {
    "speed_mm_s": 50.0,
    "sample_interval": 0.05,
    "settle_s": 0.3,
    "reach_tol": 0.02,
    "stall_cycles": 5,
    "stall_ratio": 0.2,
    "stall_delta": 0.0015,
    "max_lead_mm": 4.0,
    "press_overshoot": 0.05,
    "press_zone_mm": 2.0,
    "stop_lead_mm": 0.7,
    "stop_tol": 0.02,
    "enable_retries": 3,
    "enable_retry_interval": 0.2,
    "calib_step_rad": 0.05,
    "calib_tau_limit": 2.0,
}


def test_the_defaults_are_the_vendors() -> None:
    assert {field.name: getattr(CONFIG, field.name) for field in fields(CONFIG)} == VENDOR


@pytest.mark.parametrize("name", sorted(VENDOR))
def test_each_field_has_its_range(name: str) -> None:
    lowest, highest = RANGES[name]
    for allowed in (lowest, highest):
        changed: dict[str, Any] = {name: allowed}
        assert getattr(MotionConfig(**changed), name) == allowed
    for bad in (lowest - 1e-6, highest * 1.001, math.nan, math.inf):
        wrong: dict[str, Any] = {name: bad}
        with pytest.raises(ValueError, match=name):
            MotionConfig(**wrong)


def conflict_of(config: MotionConfig = CONFIG, speed_mm_s: float = 50.0) -> str | None:
    found = move_conflict(config, speed_mm_s, GEOMETRY, 0.005)
    return None if found is None else found.field


def test_the_defaults_go_together() -> None:
    assert conflict_of() is None


@given(st.floats(2.81, 139.9))
def test_speeds_between_the_limits_go_with_the_defaults(speed_mm_s: float) -> None:
    assert conflict_of(speed_mm_s=speed_mm_s) is None


@pytest.mark.parametrize("speed", [2.7, 0.0, -50.0, 140.1, 1e9, math.nan, math.inf, -math.inf])
def test_other_speeds_do_not(speed: float) -> None:
    assert conflict_of(speed_mm_s=speed) == "speed_mm_s"


def test_the_limits_of_the_speed_follow_from_the_other_settings() -> None:
    assert conflict_of(replace(CONFIG, stop_lead_mm=0.1), 25.0) == "speed_mm_s"  # above 20
    assert conflict_of(replace(CONFIG, stop_lead_mm=2.0), 250.0) is None
    assert conflict_of(replace(CONFIG, stall_cycles=1), 10.0) == "speed_mm_s"  # below 14
    assert conflict_of(replace(CONFIG, stall_delta=0.05), 20.0) == "speed_mm_s"


def test_the_overshoot_must_reach_beyond_the_tolerance() -> None:
    assert conflict_of(replace(CONFIG, press_overshoot=0.0)) == "press_overshoot"
    assert conflict_of(replace(CONFIG, press_overshoot=0.012)) == "press_overshoot"
    assert conflict_of(replace(CONFIG, press_overshoot=0.013)) is None
    assert conflict_of(replace(CONFIG, reach_tol=0.1)) == "press_overshoot"
