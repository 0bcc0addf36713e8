"""The tunables, their ranges, and which of them do not go together."""

import math
from dataclasses import fields, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import (
    DM4310,
    FASTEST_MM_S,
    FASTEST_RAD_S,
    MOTOR_TYPES,
    Geometry,
    MotorType,
)
from litegripd.model.motion_config import (
    MOST_PUSH_NM,
    MOVING_KP_NM_RAD,
    WIDEST,
    MotionConfig,
    MotionConfigError,
    fast_conflict,
    move_conflict,
    ranges_of,
)

CONFIG = MotionConfig()
GEOMETRY = NOMINAL[0]
VENDOR = {
    "speed_mm_s": 50.0,
    "grasp_speed_mm_s": 50.0,
    "margin": 0.05,
    "frame_interval": 0.005,
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
    "force_n": 20.0,
    "hold_interval": 0.2,
    "hold_kp": 150.0,
    "hold_kd": 2.0,
    "enable_retries": 3,
    "enable_retry_interval": 0.2,
    "calib_kp": 20.0,
    "calib_kd": 2.0,
    "calib_step_rad": 0.05,
    "calib_tau_limit": 2.0,
    "calib_stall_delta": 0.0015,
    "calib_stall_cycles": 5,
    "calib_max_iter": 200,
}
RANGES = ranges_of(DM4310)
FIELD = {"force_rate_n_s": 20.0, "stop_torque_nm": 0.7, "stop_torque_cycles": 3}
FIELD["stop_release_s"] = 0.2
TOGETHER = {"max_lead_mm": {"stop_lead_mm": 0.1}, "stop_lead_mm": {"max_lead_mm": 6.0}}
"""What a field at its extremes needs of another one."""


def test_the_defaults_are_the_vendors() -> None:
    assert CONFIG.as_fields(0.005) == VENDOR | FIELD


@pytest.mark.parametrize("motor_type", MOTOR_TYPES.values(), ids=MOTOR_TYPES)
@pytest.mark.parametrize("name", sorted(RANGES))
def test_each_field_has_its_range(name: str, motor_type: MotorType) -> None:
    lowest, highest = ranges_of(motor_type)[name]
    kind = type(getattr(CONFIG, name))
    for allowed in (lowest, highest):
        changed: dict[str, Any] = {**TOGETHER.get(name, {}), name: kind(allowed)}
        assert getattr(CONFIG.changed(changed, 0.005, motor_type), name) == allowed
    for bad in (lowest - 1e-6, highest * 1.001, math.nan, math.inf):
        wrong: dict[str, Any] = {name: bad}
        with pytest.raises(MotionConfigError, match=name):
            CONFIG.changed(wrong, 0.005, motor_type)


@pytest.mark.parametrize("name", sorted(RANGES))
def test_no_configuration_has_what_no_motor_bears(name: str) -> None:
    lowest, highest = WIDEST[name]
    for bad in (lowest - 1e-6, highest * 1.001, math.nan, math.inf):
        wrong: dict[str, Any] = {name: bad}
        with pytest.raises(MotionConfigError, match=name):
            MotionConfig(**wrong)


@pytest.mark.parametrize("motor_type", MOTOR_TYPES.values(), ids=MOTOR_TYPES)
def test_the_defaults_suit_every_motor(motor_type: MotorType) -> None:
    fields_of = {name: getattr(CONFIG, name) for name in RANGES}
    assert CONFIG.changed(fields_of, 0.005, motor_type) == CONFIG


def conflict_of(
    config: MotionConfig = CONFIG, speed_mm_s: float = 50.0, geometry: Geometry = GEOMETRY
) -> str | None:
    found = move_conflict(config, speed_mm_s, geometry, DM4310)
    return None if found is None else found.field


def test_the_defaults_go_together() -> None:
    assert conflict_of() is None


WINDOW_S = CONFIG.stall_cycles * CONFIG.sample_interval
SLOWEST_MM_S = CONFIG.stop_nm / MOVING_KP_NM_RAD * GEOMETRY.rad_to_mm / WINDOW_S
"""In a stall window a slower command would not press with `stop_lead_mm`: 2.0 mm/s."""


@given(st.floats(1.001 * SLOWEST_MM_S, FASTEST_MM_S))
def test_speeds_between_the_limits_go_with_the_defaults(speed_mm_s: float) -> None:
    assert conflict_of(speed_mm_s=speed_mm_s) is None


@pytest.mark.parametrize(
    "speed",
    [0.999 * SLOWEST_MM_S, 0.0, -50.0, FASTEST_MM_S + 0.1, 1e9, math.nan, math.inf, -math.inf],
)
def test_other_speeds_do_not(speed: float) -> None:
    assert conflict_of(speed_mm_s=speed) == "speed_mm_s"


def test_the_limits_of_the_speed_follow_from_the_other_settings() -> None:
    shorter = replace(CONFIG, stall_cycles=1)
    assert conflict_of(shorter, 4.99 * SLOWEST_MM_S) == "speed_mm_s"
    assert conflict_of(shorter, 5.01 * SLOWEST_MM_S) is None
    harder = replace(CONFIG, stop_lead_mm=1.4)
    assert conflict_of(harder, 1.99 * SLOWEST_MM_S) == "speed_mm_s"
    assert conflict_of(harder, 2.01 * SLOWEST_MM_S) is None
    coarse_mm_s = 1.5 * 0.05 * GEOMETRY.rad_to_mm / WINDOW_S
    coarse = replace(CONFIG, stall_delta=0.05)
    assert conflict_of(coarse, 0.999 * coarse_mm_s) == "speed_mm_s"
    assert conflict_of(coarse, 1.001 * coarse_mm_s) is None


@given(st.floats(1.0, 300.0), st.floats(1.0, 200.0))
def test_no_scale_makes_the_jaws_faster_at_the_motor(rad_to_mm: float, speed_mm_s: float) -> None:
    geometry = replace(GEOMETRY, rad_to_mm=rad_to_mm)
    found = fast_conflict(speed_mm_s, geometry, DM4310)
    is_fast = speed_mm_s > FASTEST_MM_S or speed_mm_s / rad_to_mm > FASTEST_RAD_S
    assert (found is not None) == is_fast


def test_the_bound_that_a_speed_breaks_is_told() -> None:
    at_jaws = fast_conflict(150.1, GEOMETRY, DM4310)
    assert at_jaws is not None
    assert at_jaws.message == "speed_mm_s is 150.1, it must be at most 150"
    at_motor = fast_conflict(100.0, replace(GEOMETRY, rad_to_mm=20.0), DM4310, "grasp_speed_mm_s")
    assert at_motor is not None
    assert at_motor.field == "grasp_speed_mm_s"
    assert at_motor.limit == pytest.approx(20.0 * FASTEST_RAD_S)
    assert "at most 58: the motor turns at no more than 2.9 rad/s" in at_motor.message
    assert "the calibration has 20 mm/rad" in at_motor.message


@given(st.floats(0.1, 6.0), st.floats(45.0, 80.0))
def test_leads_are_torques_whatever_the_scale(lead_mm: float, rad_to_mm: float) -> None:
    config = replace(CONFIG, max_lead_mm=lead_mm, stop_lead_mm=min(lead_mm, 0.7))
    assert config.travel_nm == pytest.approx(min(100.0 / 74.8 * lead_mm, MOST_PUSH_NM))
    slowest = move_conflict(config, 1e-9, replace(GEOMETRY, rad_to_mm=rad_to_mm), DM4310)
    assert slowest is not None
    assert slowest.limit / rad_to_mm >= config.stop_nm / MOVING_KP_NM_RAD / WINDOW_S * 0.999


def test_the_default_leads_press_with_the_vendors_torques_as_far_as_is_safe() -> None:
    assert CONFIG.travel_nm == MOST_PUSH_NM < 5.35  # the vendor's
    assert CONFIG.stop_nm == pytest.approx(0.936, abs=0.0005)
    assert replace(CONFIG, stop_lead_mm=3.0).stop_nm == MOST_PUSH_NM


def test_the_overshoot_must_reach_beyond_the_tolerance() -> None:
    assert conflict_of(replace(CONFIG, press_overshoot=0.0)) == "press_overshoot"
    assert conflict_of(replace(CONFIG, press_overshoot=0.012)) == "press_overshoot"
    assert conflict_of(replace(CONFIG, press_overshoot=0.013)) is None
    assert conflict_of(replace(CONFIG, reach_tol=0.1)) == "press_overshoot"


def test_every_field_has_a_range_and_only_those() -> None:
    assert {field.name for field in fields(CONFIG)} == RANGES.keys()


@pytest.mark.parametrize(
    ("values", "field", "word"),
    [
        ({"froce_n": 5}, "froce_n", "there are: frame_interval, speed_mm_s"),
        ({"force_n": "5"}, "force_n", "a number"),
        ({"force_n": True}, "force_n", "a number"),
        ({"force_n": 10**400}, "force_n", "too large"),
        ({"stall_cycles": 5.0}, "stall_cycles", "an integer"),
        ({"stall_cycles": True}, "stall_cycles", "an integer"),
        ({"force_n": 41}, "force_n", "0.5 to 40"),
        ({"force_n": math.nan}, "force_n", "0.5 to 40"),
        ({"frame_interval": 0.01}, "frame_interval", "read-only"),
        ({"frame_interval": "0.005"}, "frame_interval", "read-only"),
        ({"frame_interval": 10**400}, "frame_interval", "read-only"),
        ({"frame_interval": -(10**400)}, "frame_interval", "read-only"),
        ({"stop_lead_mm": 2.0, "max_lead_mm": 1.0}, "stop_lead_mm", "at most max_lead_mm"),
        ({"calib_kp": 100.1}, "calib_kp", "2 to 100"),
    ],
)
def test_what_a_client_may_not_change_is_named(
    values: dict[str, Any], field: str, word: str
) -> None:
    with pytest.raises(MotionConfigError, match=word) as caught:
        CONFIG.changed(values, 0.005)
    assert caught.value.field == field


def test_a_client_changes_what_it_names_and_nothing_else() -> None:
    changed = CONFIG.changed({"force_n": 5, "stall_cycles": 7, "frame_interval": 0.005}, 0.005)
    assert changed == replace(CONFIG, force_n=5.0, stall_cycles=7)
    assert isinstance(changed.force_n, float)
