"""Calibration files: the vendor's, templates, and what must not pass."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.calibration import (
    NOMINAL,
    SUPERSEDED,
    Calibration,
    CalibrationError,
    from_plain,
    measured,
    parse_calibration,
    plausible_travel_rad,
    read_given,
    scale_doubt,
    scale_warning,
    to_plain,
    unfitting,
)
from litegripd.model.gripper import DM4310, NUMBERED_TYPES, SPAN_INSET_MM, STROKE_MM, Geometry

FACTORY: dict[str, object] = {
    "channel": "can0",
    "can_id": 8,
    "mst_id": 24,
    "canfd_mode": False,
    "calibrated": True,
    "zero_position_rad": NOMINAL[0].closed_rad,
    "max_position_rad": NOMINAL[0].open_rad,
    "travel_range_rad": NOMINAL[0].travel_rad,
    "rad_to_mm": NOMINAL[0].rad_to_mm,
    "motor_type": "DM4310",
    "kp": 100.0,
    "kd": 2.0,
    "grasp_torque_threshold": 0.5,
}


def changed(**changes: object) -> str:
    return json.dumps(FACTORY | changes)


def test_the_factory_file() -> None:
    read = parse_calibration(json.dumps(FACTORY))
    assert read.geometry == NOMINAL[0]
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
        (changed(rad_to_mm=float("nan")), "rad_to_mm is NaN, it must be 0.001 to 1000000"),
        (
            changed(zero_position_rad=float("inf")),
            "zero_position_rad is Infinity, it must be -100 to 100",
        ),
        (
            changed(zero_position_rad=7).replace("7", "1e999", 1),
            "zero_position_rad is 1e999, it must be -100 to 100",
        ),
        (changed(zero_position_rad=10**400), "zero_position_rad is 1000.*000, it must be -100"),
        (changed(kp=7).replace("7", "-1e400", 1), "kp is -1e400, it must be 1 to 500"),
        (changed(can_id=7).replace("7", "1e400", 1), "can_id is 1e400, it must be a finite number"),
        (changed(note={"a": [1, float("nan")]}), r"note\.a\.1 is NaN, it must be a finite number"),
        (changed(zero_position_rad=NOMINAL[0].open_rad), "equal"),
        (changed(kp=501), "kp"),
        (changed(kp=-1), "kp"),
        (changed(kp=0), "kp is 0.0, it must be 1 to 500"),
        (changed(kd=5.1), "kd"),
        (changed(calibrated=1), "calibrated"),
        (changed(channel=3), "channel"),
        (changed(work_stroke_mm=-0.1), "work_stroke_mm is -0.1, it must be the opening"),
        (changed(work_stroke_mm="80"), "work_stroke_mm"),
        (changed(work_stroke_mm=float("nan")), "work_stroke_mm is NaN, it must be the opening"),
        (changed(nm_to_n=4.9), "nm_to_n is 4.9, it must be 5 to 30"),
        (changed(nm_to_n=30.1), "nm_to_n is 30.1, it must be 5 to 30"),
        (changed(nm_to_n="10"), "nm_to_n"),
        ('{"zero_position_rad": 0.1, "rad_to_mm": 74.8}', "max_position_rad"),
        (changed(motor_type="DM6248P"), "motor_type is 'DM6248P', .*missing: gear ratio"),
        (changed(motor_type="DM1"), "motor_type is 'DM1', .*it must be DM4310 or DM4340"),
        (
            changed(motor_type=NUMBERED_TYPES.index("DM6006")),
            "motor_type is 'DM6006', .*missing",
        ),
        # What readers would read differently.
        ('{"rad_to_mm": 74.8, "rad_to_mm": 54.4}', "the same key twice: 'rad_to_mm'"),
        ('{"rad_to_mm": ' + "9" * 5000 + "}", "rad_to_mm is 999.*999, it must be"),
        ('{"rad_to_mm": NaN}', "rad_to_mm is NaN, it must be"),
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


@pytest.mark.parametrize("motor_type", ["DM4310", "DM4340", "", None, 1, 3])
def test_any_other_file_is_taken_whatever_it_says_of_its_motor(motor_type: object) -> None:
    assert parse_calibration(changed(motor_type=motor_type)).content["motor_type"] == motor_type


def test_a_calibration_without_a_file_makes_the_vendors_whole_file() -> None:
    content = content_of(Calibration(BENCH))
    assert list(content) == list(FACTORY)
    assert content == {
        **FACTORY,
        "channel": "can1",
        "can_id": 9,
        "zero_position_rad": 0.104334,
        "max_position_rad": -1.513123,
        "travel_range_rad": pytest.approx(1.617457),
        "rad_to_mm": 74.19,
    }


def test_a_rewrite_changes_what_was_measured_and_keeps_the_rest() -> None:
    text = changed(
        can_id=8, mst_id=25, canfd_mode=True, kp=50, kd=1, grasp_torque_threshold=0.7, note=[1]
    )
    before = parse_calibration(text)
    after = measured(before, closed_rad=-1.5, open_rad=0.1, stroke_mm=STROKE_MM)
    assert content_of(after, 24) == {
        **json.loads(text),
        "channel": "can1",
        "can_id": 9,
        "mst_id": 24,  # by which a file says of which motor it is: this one, from now on
        "canfd_mode": False,
        "zero_position_rad": -1.5,
        "max_position_rad": 0.1,
        "travel_range_rad": 1.6,
        "rad_to_mm": (STROKE_MM + 1.0) / 1.6,
    }


@pytest.mark.parametrize(
    ("work_mm", "opening_mm"),
    [(None, None), (0, None), (0.1, 0.1), (80.0, 80.0), (86.9, 86.9), (87.0, None), (500, None)],
)
def test_a_work_stroke_inside_the_travel_is_where_open_goes(
    work_mm: float | None, opening_mm: float | None
) -> None:
    read = parse_calibration(changed(work_stroke_mm=work_mm))
    assert read.work_opening_mm == opening_mm


@pytest.mark.parametrize("nm_to_n", [5, 10.0, 19.0, 30])
def test_force_per_torque_is_the_files_and_kept(nm_to_n: float) -> None:
    read = parse_calibration(changed(nm_to_n=nm_to_n, work_stroke_mm=80.0))
    assert read.geometry.force_n(2.0) == pytest.approx(2.0 * nm_to_n)
    assert read.geometry.torque_nm(20.0) == pytest.approx(20.0 / nm_to_n)
    after = measured(read, closed_rad=0.1, open_rad=-1.5, stroke_mm=STROKE_MM)
    for calibration in (after, read.rescaled(75.0), from_plain(to_plain(after))):
        assert calibration.geometry.nm_to_n == nm_to_n
        content = content_of(calibration)
        assert (content["nm_to_n"], content["work_stroke_mm"]) == (nm_to_n, 80.0)
        again = parse_calibration(json.dumps(content))
        assert (again.geometry, again.work_stroke_mm) == (calibration.geometry, 80.0)


def test_a_template_sets_the_work_stroke_which_a_measurement_and_its_file_keep() -> None:
    template = parse_calibration(changed(work_stroke_mm=80.0)).direction_only()
    assert template.work_opening_mm == 80.0
    after = measured(template, closed_rad=0.1, open_rad=-1.5, stroke_mm=STROKE_MM)
    assert content_of(after)["work_stroke_mm"] == 80.0
    assert "work_stroke_mm" not in content_of(parse_calibration(changed(work_stroke_mm=0)))


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
    ("kp", "kd"),
    [(500, 0), (500, 1.0), (100, 0.2), (1, 0), (None, 0), (None, 0.1), (500, None), (None, None)],
)
def test_gains_are_taken_with_any_damping(kp: float | None, kd: float | None) -> None:
    calibration = parse_calibration(changed(kp=kp, kd=kd))
    assert (calibration.kp_nm_rad, calibration.kd_nm_s_rad) == (kp, kd)


def test_gains_that_are_known_without_a_file_go_into_it() -> None:
    content = content_of(Calibration(BENCH, kp_nm_rad=60.0, kd_nm_s_rad=0.0))
    assert (content["kp"], content["kd"]) == (60.0, 0.0)


def test_a_gripper_that_never_was_calibrated_stays_so_until_it_is_measured() -> None:
    before = parse_calibration(changed(calibrated=False))
    assert content_of(before)["calibrated"] is False
    after = measured(before, closed_rad=0.1, open_rad=-1.5, stroke_mm=STROKE_MM)
    assert content_of(after)["calibrated"] is True


def test_a_measurement_gives_the_scale_and_keeps_gains_and_content() -> None:
    before = parse_calibration(changed(note="mine"))
    after = measured(before, closed_rad=0.104334, open_rad=-1.513123, stroke_mm=STROKE_MM)
    assert after.geometry.rad_to_mm == pytest.approx(86.0 / 1.617457)
    assert after.geometry.travel_mm == pytest.approx(STROKE_MM + 1.0)
    assert (after.kp_nm_rad, after.kd_nm_s_rad, after.channel) == (100.0, 2.0, "can0")
    marks = {"can_id", "mst_id", "canfd_mode", "motor_type"}
    assert after.content == {k: v for k, v in before.content.items() if k not in marks}
    assert before.geometry == NOMINAL[0]


def test_a_measurement_without_a_calibration_before() -> None:
    after = measured(None, closed_rad=-1.5, open_rad=0.1, stroke_mm=79.0)
    assert after == Calibration(Geometry(-1.5, 0.1, 50.0))


@pytest.mark.parametrize(
    ("closed_rad", "open_rad", "stroke_mm", "reason"),
    [
        (0.1, 0.1, STROKE_MM, "equal"),
        (0.1, 0.1001, STROKE_MM, "less than a jaw"),
        (float("nan"), 0.1, STROKE_MM, "finite"),
        (0.1, -1.5, float("nan"), "finite"),
        (0.1, -1.5, float("inf"), "finite"),
        (0.1, -1.5, 0.0, "above 0"),
        (0.1, -1.5, -STROKE_MM, "above 0"),
        (0.1, -101.0, STROKE_MM, "beyond"),
    ],
)
def test_a_measurement_that_no_gripper_gives_is_refused(
    closed_rad: float, open_rad: float, stroke_mm: float, reason: str
) -> None:
    with pytest.raises(CalibrationError, match=f"measured stops cannot be used: .*{reason}"):
        measured(None, closed_rad=closed_rad, open_rad=open_rad, stroke_mm=stroke_mm)


# What fits a gripper, and what is doubtful


SPAN_MM = STROKE_MM + SPAN_INSET_MM
PMAX_RAD = DM4310.ranges.position_rad
scales = st.floats(40.0, 90.0)
travels_rad = st.floats(0.5, 3.0)


def of_travel(travel_rad: float, rad_to_mm: float) -> Calibration:
    return Calibration(Geometry(0.1, 0.1 - travel_rad, rad_to_mm))


@given(travels_rad, st.floats(0.1, 3.0))
def test_only_a_travel_near_the_stroke_or_the_placeholder_of_earlier_versions_fits(
    travel_rad: float, share: float
) -> None:
    calibration = of_travel(travel_rad, share * SPAN_MM / travel_rad)
    travel_mm = calibration.geometry.travel_mm
    fits = abs(travel_mm / SPAN_MM - 1.0) <= 0.15 or abs(travel_mm / 120.0 - 1.0) <= 0.02
    why = unfitting(calibration, STROKE_MM, PMAX_RAD)
    assert (why is None) is fits
    if why is not None:
        assert f"{travel_mm:.4g} mm of travel" in why
        assert "the configured stroke is 85 mm (86 between the limits)" in why
        assert f"rad_to_mm ({SPAN_MM / travel_rad:.4g} for these limits)" in why
        assert "measure again (calibration.zero with a mount)" in why
        assert "set stroke_mm in [gripper]" in why


DEGREES = 57.29578


@pytest.mark.parametrize("factor", [0.5, 2.0, 10.0, DEGREES])
@pytest.mark.parametrize("geometry", NOMINAL)
def test_a_scale_or_limits_off_by_a_factor_do_not_fit(geometry: Geometry, factor: float) -> None:
    closed_rad, open_rad = factor * geometry.closed_rad, factor * geometry.open_rad
    scale = replace(geometry, rad_to_mm=factor * geometry.rad_to_mm)
    for other in (scale, Geometry(closed_rad, open_rad, geometry.rad_to_mm)):
        assert unfitting(Calibration(other), STROKE_MM, PMAX_RAD) is not None
    if factor >= 10.0:  # even if the travel in mm is right
        degrees = Geometry(closed_rad, open_rad, geometry.rad_to_mm / factor)
        why = unfitting(Calibration(degrees), STROKE_MM, PMAX_RAD) or ""
        assert "the motor reports at most ±12.5 rad: limits are radians, not degrees" in why


def test_limits_beyond_what_the_motor_reports_do_not_fit() -> None:
    at_edge = Calibration(Geometry(12.5, 12.5 - 1.6, 53.75))
    assert unfitting(at_edge, STROKE_MM, PMAX_RAD) is None
    for geometry in (Geometry(12.51, 10.91, 53.75), Geometry(-10.91, -12.51, 53.75)):
        assert "a limit is" in (unfitting(Calibration(geometry), STROKE_MM, PMAX_RAD) or "")
    assert unfitting(at_edge, STROKE_MM, 6.25) is not None


@pytest.mark.parametrize("geometry", SUPERSEDED)
def test_the_scale_of_earlier_versions_is_taken_and_warned_of(geometry: Geometry) -> None:
    calibration = Calibration(geometry)
    assert unfitting(calibration, STROKE_MM, PMAX_RAD) is None
    assert scale_doubt(calibration, STROKE_MM) == "superseded"
    warning = scale_warning(calibration, STROKE_MM) or ""
    assert "takes the jaws' travel for 120.1 mm, as earlier versions did" in warning
    assert "they open 85 mm, so every length and speed in mm reads 1.40 times too large" in warning
    assert "calibration.rescale corrects it" in warning
    rescaled = calibration.rescaled(STROKE_MM)
    assert (rescaled.geometry.closed_rad, rescaled.geometry.open_rad) == (
        geometry.closed_rad,
        geometry.open_rad,
    )
    assert scale_doubt(rescaled, STROKE_MM) is None
    assert rescaled.nominal  # its limits were still measured on no gripper


@given(scales)
def test_a_scale_that_no_gripper_was_seen_to_have_is_unusual(rad_to_mm: float) -> None:
    calibration = of_travel(SPAN_MM / rad_to_mm, rad_to_mm)
    assert unfitting(calibration, STROKE_MM, PMAX_RAD) is None
    is_usual = 45.0 <= rad_to_mm <= 80.0
    assert scale_doubt(calibration, STROKE_MM) == (None if is_usual else "unusual")
    warning = scale_warning(calibration, STROKE_MM)
    assert (warning is None) is is_usual
    if warning is not None:
        assert f"has {rad_to_mm:.4g} mm/rad, and grippers of 45 to 80 mm/rad were seen" in warning
        assert "calibration.rescale with stroke_mm" in warning


def test_the_gripper_that_ships_is_not_doubted() -> None:
    for geometry in NOMINAL:
        assert unfitting(Calibration(geometry), STROKE_MM, PMAX_RAD) is None
        assert scale_warning(Calibration(geometry), STROKE_MM) is None
    assert NOMINAL[0].travel_mm == pytest.approx(SPAN_MM, rel=0.012)


@pytest.mark.parametrize("geometry", NOMINAL + SUPERSEDED)
@pytest.mark.parametrize("travel_rad", [1.314183, 1.840238])
def test_units_that_were_seen_are_plausible_after_a_template(
    geometry: Geometry, travel_rad: float
) -> None:
    low_rad, high_rad = plausible_travel_rad(Calibration(geometry))
    assert low_rad < travel_rad < high_rad


def test_after_a_template_an_object_between_the_jaws_is_no_closed_stop() -> None:
    object_mm, travel_rad = 24.0, NOMINAL[0].travel_rad
    low_rad, _ = plausible_travel_rad(Calibration(NOMINAL[0]))
    assert travel_rad * (1.0 - object_mm / SPAN_MM) < low_rad


def test_after_a_measurement_less_is_plausible() -> None:
    measured_before = of_travel(1.6, 53.75)
    assert plausible_travel_rad(measured_before) == pytest.approx((1.28, 2.0))


def test_other_force_or_scale_does_not_make_a_templates_limits_measured() -> None:
    closed_rad, open_rad = NOMINAL[1].closed_rad, NOMINAL[1].open_rad
    assert Calibration(Geometry(closed_rad, open_rad, 52.69, 19.0)).nominal
    assert Calibration(Geometry(closed_rad, open_rad, 50.0)).nominal
    assert not Calibration(Geometry(closed_rad + 1e-6, open_rad, 52.69)).nominal


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
    assert set(others) <= {*read.content, "mst_id"}
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


@pytest.mark.parametrize("key", ["zero_position_rad", "max_position_rad", "rad_to_mm", "kp", "kd"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), "1", True, [1.0]])
def test_what_a_request_brings_has_only_finite_numbers(key: str, value: object) -> None:
    content = {"zero_position_rad": 0.0, "max_position_rad": -1.65, "rad_to_mm": 52.0, key: value}
    with pytest.raises(CalibrationError, match=key):
        read_given(content)


def test_what_a_request_brings_says_nothing_of_the_gripper() -> None:
    content = {"zero_position_rad": 0.0, "max_position_rad": -1.65, "rad_to_mm": 52.0}
    assert read_given(content).geometry.travel_rad == 1.65
    for key in ("channel", "can_id", "nm_to_n", "calibrated", "travel_range_rad"):
        with pytest.raises(KeyError, match=key):
            read_given({**content, key: 1})
