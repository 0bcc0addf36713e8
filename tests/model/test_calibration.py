"""Calibration files: the vendor's, templates, and what must not pass."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.calibration import CalibrationError, parse_calibration

FACTORY: dict[str, object] = {
    "channel": "can0",
    "can_id": 8,
    "mst_id": 24,
    "canfd_mode": False,
    "calibrated": True,
    "zero_position_rad": 0.114,
    "max_position_rad": -1.491,
    "travel_range_rad": 1.605,
    "rad_to_mm": 74.8,
    "motor_type": "DM4310",
    "kp": 100.0,
    "kd": 2.0,
    "grasp_torque_threshold": 0.5,
}


def changed(**changes: object) -> str:
    return json.dumps(FACTORY | changes)


def test_the_factory_file() -> None:
    read = parse_calibration(json.dumps(FACTORY))
    assert (read.geometry.closed_rad, read.geometry.open_rad) == (0.114, -1.491)
    assert read.geometry.rad_to_mm == 74.8
    assert (read.kp_nm_rad, read.kd_nm_s_rad) == (100.0, 2.0)
    assert (read.channel, read.calibrated) == ("can0", True)


def test_three_keys_are_enough_and_count_as_calibrated() -> None:
    text = '{"zero_position_rad": -1.491, "max_position_rad": 0.114, "rad_to_mm": 74.8}'
    read = parse_calibration(text)
    assert read.calibrated
    assert read.geometry.mount == "reverse"
    assert (read.kp_nm_rad, read.kd_nm_s_rad, read.channel) == (None, None, None)


def test_unknown_keys_are_kept_and_a_template_brings_direction_only() -> None:
    read = parse_calibration(changed(note="mine"))
    assert read.content["note"] == "mine"
    template = read.direction_only()
    assert template.geometry == read.geometry
    assert (template.kp_nm_rad, template.channel, template.content) == (None, None, {})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "JSON"),
        ("{", "JSON"),
        ("[" * 100_000, "JSON"),
        ("[]", "object"),
        ("null", "object"),
        (changed(rad_to_mm=None), "rad_to_mm"),
        (changed(rad_to_mm="74.8"), "rad_to_mm"),
        (changed(rad_to_mm=True), "rad_to_mm"),
        (changed(rad_to_mm=0), "rad_to_mm"),
        (changed(rad_to_mm=float("nan")), "rad_to_mm"),
        (changed(zero_position_rad=float("inf")), "zero_position_rad"),
        (changed(zero_position_rad=10**400), "zero_position_rad"),
        (changed(zero_position_rad=-1.491), "equal"),
        (changed(kp=501), "kp"),
        (changed(kp=-1), "kp"),
        (changed(kd=5.1), "kd"),
        (changed(calibrated=1), "calibrated"),
        (changed(channel=3), "channel"),
        ('{"zero_position_rad": 0.1, "rad_to_mm": 74.8}', "max_position_rad"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason(text: str, reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        parse_calibration(text)


values = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)


@given(
    st.text(max_size=40)
    | st.dictionaries(st.sampled_from(sorted(FACTORY)), values).map(
        lambda d: json.dumps(FACTORY | d)
    )
)
def test_any_text_gives_a_calibration_or_its_error(text: str) -> None:
    try:
        read = parse_calibration(text)
    except CalibrationError:
        return
    assert read.geometry.travel_mm > 0.0
    assert 0.0 <= read.geometry.openness(0.0) <= 1.0
