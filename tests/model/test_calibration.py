"""Calibration files: the vendor's, templates, and what must not pass."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.calibration import (
    Calibration,
    CalibrationError,
    measured,
    parse_calibration,
)
from litegripd.model.gripper import Geometry

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
        (changed(kp=0), "kp is 0.0, it must be 1 to 500"),
        (changed(kd=5.1), "kd"),
        (changed(kp=500, kd=0), "kd is 0, with kp 500 it must be at least 1: with less damping"),
        (changed(kp=500, kd=0.99), "it must be at least 1"),
        (changed(kp=None, kd=0.1), "kd is 0.1, with kp 100 it must be at least 0.2"),
        (changed(kd=0), "swing by themselves"),
        (changed(calibrated=1), "calibrated"),
        (changed(channel=3), "channel"),
        ('{"zero_position_rad": 0.1, "rad_to_mm": 74.8}', "max_position_rad"),
        (changed(note=json.loads("[" * 16 + "]" * 16)), "nested more than 16 deep"),
        (changed(note=json.loads('{"a":' * 100 + "1" + "}" * 100)), "nested more than 16 deep"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason(text: str, reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        parse_calibration(text)


def test_a_reason_is_short_however_long_the_value() -> None:
    with pytest.raises(CalibrationError) as caught:
        parse_calibration(changed(rad_to_mm="x" * 10_000))
    assert len(str(caught.value)) < 100


def test_some_nesting_is_kept() -> None:
    note = json.loads("[" * 15 + "]" * 15)
    assert parse_calibration(changed(note=note)).content["note"] == note


BENCH = Geometry(0.104334, -1.513123, 74.19)


def content_of(
    calibration: Calibration, master_id: int | None = 24, motor_type: str = "DM4310"
) -> dict[str, object]:
    return calibration.file_content(
        channel="can1",
        can_id=9,
        master_id=master_id,
        motor_type=motor_type,
        kp_nm_rad=100.0,
        kd_nm_s_rad=2.0,
    )


@pytest.mark.parametrize(
    ("before", "after"), [("DM4310", "DM4340"), (None, "DM4340"), ("DM9999", "DM9999")]
)
def test_the_file_names_the_configured_type_in_place_of_another_known_one(
    before: str | None, after: str
) -> None:
    calibration = Calibration(BENCH, content={"motor_type": before})
    assert content_of(calibration, motor_type="DM4340")["motor_type"] == after


@pytest.mark.parametrize(
    ("motor_type", "why"),
    [("DM6248P", "missing: gear ratio"), ("DM1", "it must be DM4310 or DM4340")],
)
def test_a_file_of_a_motor_that_cannot_be_driven_is_refused(motor_type: str, why: str) -> None:
    with pytest.raises(CalibrationError, match=f"motor_type is '{motor_type}', .*{why}"):
        parse_calibration(changed(motor_type=motor_type))


@pytest.mark.parametrize("motor_type", ["DM4310", "DM4340", "", None, 1])
def test_any_other_file_is_taken_whatever_it_says_of_its_motor(motor_type: object) -> None:
    assert parse_calibration(changed(motor_type=motor_type)).content["motor_type"] == motor_type


def test_a_calibration_without_a_file_makes_the_vendors_whole_file() -> None:
    content = content_of(Calibration(BENCH))
    assert list(content) == list(FACTORY)
    assert content == {
        "channel": "can1",
        "can_id": 9,
        "mst_id": 24,
        "canfd_mode": False,
        "calibrated": True,
        "zero_position_rad": 0.104334,
        "max_position_rad": -1.513123,
        "travel_range_rad": pytest.approx(1.617457),
        "rad_to_mm": 74.19,
        "motor_type": "DM4310",
        "kp": 100.0,
        "kd": 2.0,
        "grasp_torque_threshold": 0.5,
    }


def test_a_rewrite_changes_what_was_measured_and_keeps_the_rest() -> None:
    text = changed(
        can_id=8, mst_id=25, canfd_mode=True, kp=50, kd=1, grasp_torque_threshold=0.7, note=[1]
    )
    before = parse_calibration(text)
    after = measured(before, closed_rad=-1.5, open_rad=0.1, stroke_mm=120.0)
    assert content_of(after) == {
        **json.loads(text),
        "channel": "can1",
        "zero_position_rad": -1.5,
        "max_position_rad": 0.1,
        "travel_range_rad": 1.6,
        "rad_to_mm": 75.0,
    }


def test_what_a_file_leaves_open_is_filled_in() -> None:
    before = parse_calibration(changed(mst_id=0, can_id=None, kp=None, kd=None))
    content = content_of(before)
    assert (content["mst_id"], content["can_id"]) == (24, 9)
    assert (content["kp"], content["kd"]) == (100.0, 2.0)


@pytest.mark.parametrize("unknown", [None, 0])
def test_a_master_id_that_is_not_known_is_left_out(unknown: int | None) -> None:
    assert "mst_id" not in content_of(Calibration(BENCH), unknown)
    assert "mst_id" not in content_of(parse_calibration(changed(mst_id=0)), unknown)
    assert content_of(parse_calibration(changed()), unknown)["mst_id"] == 24


@pytest.mark.parametrize(
    ("kp", "kd"), [(500, 1.0), (100, 0.2), (1, 0.002), (None, 0.2), (500, None), (None, None)]
)
def test_gains_that_damp_enough_are_taken(kp: float | None, kd: float | None) -> None:
    calibration = parse_calibration(changed(kp=kp, kd=kd))
    assert (calibration.kp_nm_rad, calibration.kd_nm_s_rad) == (kp, kd)


def test_gains_that_are_known_without_a_file_go_into_it() -> None:
    content = content_of(Calibration(BENCH, kp_nm_rad=60.0, kd_nm_s_rad=0.0))
    assert (content["kp"], content["kd"]) == (60.0, 0.0)


def test_a_gripper_that_never_was_calibrated_stays_so_until_it_is_measured() -> None:
    before = parse_calibration(changed(calibrated=False))
    assert content_of(before)["calibrated"] is False
    after = measured(before, closed_rad=0.1, open_rad=-1.5, stroke_mm=120.0)
    assert content_of(after)["calibrated"] is True


def test_a_measurement_gives_the_scale_and_keeps_gains_and_content() -> None:
    before = parse_calibration(changed(note="mine"))
    after = measured(before, closed_rad=0.104334, open_rad=-1.513123, stroke_mm=120.0)
    assert after.geometry.rad_to_mm == pytest.approx(74.19, abs=0.005)
    assert after.geometry.travel_mm == pytest.approx(120.0)
    assert (after.kp_nm_rad, after.kd_nm_s_rad, after.channel) == (100.0, 2.0, "can0")
    assert after.content == before.content
    assert before.geometry.rad_to_mm == 74.8


def test_a_measurement_without_a_calibration_before() -> None:
    after = measured(None, closed_rad=-1.5, open_rad=0.1, stroke_mm=80.0)
    assert after == Calibration(Geometry(-1.5, 0.1, 50.0))


@pytest.mark.parametrize(
    ("closed_rad", "open_rad", "stroke_mm", "reason"),
    [
        (0.1, 0.1, 120.0, "equal"),
        (0.1, 0.1001, 120.0, "less than a jaw"),
        (float("nan"), 0.1, 120.0, "finite"),
        (0.1, -1.5, float("nan"), "finite"),
        (0.1, -1.5, float("inf"), "finite"),
        (0.1, -1.5, 0.0, "above 0"),
        (0.1, -1.5, -120.0, "above 0"),
        (0.1, -101.0, 120.0, "beyond"),
    ],
)
def test_a_measurement_that_no_gripper_gives_is_refused(
    closed_rad: float, open_rad: float, stroke_mm: float, reason: str
) -> None:
    with pytest.raises(CalibrationError, match=f"measured stops cannot be used: .*{reason}"):
        measured(None, closed_rad=closed_rad, open_rad=open_rad, stroke_mm=stroke_mm)


limits_rad = st.floats(-100.0, 100.0)


@given(
    limits_rad,
    limits_rad,
    st.floats(1.0, 1000.0),
    st.dictionaries(st.text(max_size=5) | st.sampled_from(["mst_id", "can_id"]), st.integers()),
    st.none() | st.integers(0, 0x7FE),
)
def test_what_is_written_reads_back_as_it_was(
    closed_rad: float,
    open_rad: float,
    stroke_mm: float,
    others: dict[str, object],
    master_id: int | None,
) -> None:
    before = parse_calibration(json.dumps(others | FACTORY))
    try:
        after = measured(before, closed_rad=closed_rad, open_rad=open_rad, stroke_mm=stroke_mm)
    except CalibrationError:
        return
    content = content_of(after, master_id)
    read = parse_calibration(json.dumps(content))
    assert (read.geometry, read.calibrated, read.channel) == (after.geometry, True, "can1")
    assert (read.kp_nm_rad, read.kd_nm_s_rad) == (after.kp_nm_rad, after.kd_nm_s_rad)
    assert set(others) <= set(read.content)
    assert content_of(read, master_id) == content


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
