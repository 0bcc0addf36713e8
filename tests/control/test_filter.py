"""The last word on every command, whatever is asked for and whatever is measured."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.control.limiter import (
    UNSEEN_RAD_S,
    VENDOR_KD_NM_S_RAD,
    Bounds,
    CommandLimiter,
    bounds_of,
    torque_bound_nm,
)
from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import DM4310, Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand, Ranges
from litegripd.motor import codec
from tests.properties import examples

PERIOD_S = 0.005
CONFIG = MotionConfig()
GEOMETRY, OTHER = NOMINAL
PEAK_TORQUE_NM, RATED_TORQUE_NM = DM4310.peak_nm, DM4310.rated_nm
PEAK_IMPULSE_NM_S = DM4310.peak_impulse_nm_s
BOUNDS = bounds_of(GEOMETRY, CONFIG)
RANGES = DM4310.ranges
NEAR = 1.0 + 1e-9

anything = st.floats() | st.floats(-20.0, 20.0)
commands = st.builds(MitCommand, anything, anything, anything, anything, anything)
frames = st.binary(min_size=8, max_size=8)
geometries = st.none() | st.just(GEOMETRY) | st.just(OTHER)
ranges = st.just(RANGES) | st.builds(Ranges, *[st.floats(0.125, 100.0, width=32)] * 3)


def measured(position_rad: float = 0.0, velocity_rad_s: float = 0.0) -> Feedback:
    return Feedback(1, position_rad, velocity_rad_s, 0.0, 30, 30, 0.0)


def pull(position_rad: float, kp: float = 100.0, kd: float = 2.0) -> MitCommand:
    return MitCommand(position_rad, 0.0, kp, kd, 0.0)


def apply(
    command: MitCommand, feedback: Feedback, bounds: Bounds = BOUNDS
) -> tuple[MitCommand, tuple[str, ...]]:
    return CommandLimiter().apply(0.0, command, feedback, bounds, RANGES)


@given(commands, frames, geometries, ranges)
def test_any_command_becomes_one_that_may_be_sent(
    command: MitCommand, frame: bytes, geometry: Geometry | None, spans: Ranges
) -> None:
    feedback = codec.decode_feedback(frame, spans, 0.0)
    bounds = bounds_of(geometry, CONFIG)
    sent, limited = CommandLimiter().apply(0.0, command, feedback, bounds, spans)
    codec.encode_command(sent, spans)  # raises for what is not finite or out of its range
    assert torque_bound_nm(sent, feedback) <= bounds.torque_nm * NEAR
    for unseen_rad_s in (-UNSEEN_RAD_S, UNSEEN_RAD_S):  # the true speed is not the measured one
        truly = replace(feedback, velocity_rad_s=feedback.velocity_rad_s + unseen_rad_s)
        usual_nm = torque_bound_nm(sent, feedback) + VENDOR_KD_NM_S_RAD * UNSEEN_RAD_S
        assert torque_bound_nm(sent, truly) <= max(PEAK_TORQUE_NM, usual_nm) * NEAR
    here_rad = feedback.position_rad
    assert min(bounds.low_rad, here_rad) - 1e-9 <= sent.position_rad
    assert sent.position_rad <= max(bounds.high_rad, here_rad) + 1e-9
    assert abs(sent.position_rad - here_rad) <= bounds.lead_rad + 1e-9
    assert (sent != command) == bool(limited)


@examples(25)
@given(st.lists(st.tuples(commands, frames), min_size=1, max_size=5), st.integers(0, 4))
def test_the_torque_is_bounded_at_once_and_for_long(
    course: list[tuple[MitCommand, bytes]], offset: int
) -> None:
    last_word, impulse_nm_s, worst_nm_s = CommandLimiter(), 0.0, 0.0
    for tick in range(1000):
        command, frame = course[(tick // 40 + offset) % len(course)]
        feedback = codec.decode_feedback(frame, RANGES, 0.0)
        sent, _ = last_word.apply(tick * PERIOD_S, command, feedback, BOUNDS, RANGES)
        torque_nm = torque_bound_nm(sent, feedback)
        assert torque_nm <= PEAK_TORQUE_NM * NEAR
        impulse_nm_s = max(impulse_nm_s + (torque_nm - RATED_TORQUE_NM) * PERIOD_S, 0.0)
        worst_nm_s = max(worst_nm_s, impulse_nm_s)
    assert worst_nm_s <= PEAK_IMPULSE_NM_S + 2 * PERIOD_S * PEAK_TORQUE_NM


def test_the_peak_lasts_for_a_moment_and_the_rating_for_long() -> None:
    last_word = CommandLimiter()
    torques = []
    for tick in range(1000):
        sent, _ = last_word.apply(tick * PERIOD_S, pull(-1.0), measured(), BOUNDS, RANGES)
        torques.append(torque_bound_nm(sent, measured()))
    assert torques[0] == pytest.approx(PEAK_TORQUE_NM)
    assert torques[95] == pytest.approx(PEAK_TORQUE_NM)
    assert torques[105:] == pytest.approx([RATED_TORQUE_NM] * 895)


def test_the_peak_comes_back_when_the_impulse_has_drained() -> None:
    last_word = CommandLimiter()
    for tick in range(200):
        last_word.apply(tick * PERIOD_S, pull(-1.0), measured(), BOUNDS, RANGES)
    last_word.apply(1.0, pull(0.0), measured(), BOUNDS, RANGES)
    soon, _ = last_word.apply(1.3, pull(-1.0), measured(), BOUNDS, RANGES)
    assert torque_bound_nm(soon, measured()) == pytest.approx(RATED_TORQUE_NM)
    last_word.apply(1.3, pull(0.0), measured(), BOUNDS, RANGES)
    later, _ = last_word.apply(2.1, pull(-1.0), measured(), BOUNDS, RANGES)
    assert torque_bound_nm(later, measured()) == pytest.approx(PEAK_TORQUE_NM)


def test_the_time_without_power_is_charged_to_no_command() -> None:
    last_word = CommandLimiter()
    last_word.apply(0.0, pull(-1.0), measured(), BOUNDS, RANGES)
    last_word.unpowered(PERIOD_S)
    for now_s in (100.0, 100.0 + PERIOD_S):
        sent, _ = last_word.apply(now_s, pull(-1.0), measured(), BOUNDS, RANGES)
        assert torque_bound_nm(sent, measured()) == pytest.approx(PEAK_TORQUE_NM)


def test_lowered_damping_comes_back_without_power_too() -> None:
    last_word = CommandLimiter()
    thrown = measured(velocity_rad_s=20.0)
    low, _ = last_word.apply(0.0, pull(0.0), thrown, BOUNDS, RANGES)
    assert low.kd_nm_s_rad < 0.5
    for tick in range(1, 100):
        last_word.unpowered(tick * PERIOD_S)
    sent = last_word.apply(100 * PERIOD_S, pull(0.0), measured(), BOUNDS, RANGES)
    assert sent == (pull(0.0), ())


def test_a_command_within_all_limits_is_not_touched() -> None:
    for command in (pull(0.05), MitCommand(-0.02, 0.6, 100.0, 2.0, -0.3), pull(0.0, 0.0, 0.0)):
        assert apply(command, measured()) == (command, ())


@pytest.mark.parametrize("field", range(5))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_becomes_a_brake(field: int, bad: float) -> None:
    values = [0.0, 0.0, 100.0, 2.0, 0.0]
    values[field] = bad
    sent, limited = apply(MitCommand(*values), measured(-0.7, 0.1))
    assert "not_finite" in limited
    assert (sent.kp_nm_rad, sent.torque_nm, sent.velocity_rad_s) == (0.0, 0.0, 0.0)
    assert sent.kd_nm_s_rad > 0.0


def test_negative_damping_does_not_buy_torque() -> None:
    """It would lower the computed bound, and be clamped to zero afterwards."""
    feedback = measured(0.0, 2.0)
    sent, _ = apply(MitCommand(-0.1, 0.0, 100.0, -5.0, 0.0), feedback)
    assert torque_bound_nm(sent, feedback) <= PEAK_TORQUE_NM * NEAR


@pytest.mark.parametrize("outside_rad", [0.01, 0.3, 3.0])
@pytest.mark.parametrize("side", [1, -1])
def test_jaws_outside_the_travel_are_neither_led_further_out_nor_pulled_in(
    outside_rad: float, side: int
) -> None:
    edge_rad = BOUNDS.high_rad if side > 0 else BOUNDS.low_rad
    here_rad = edge_rad + side * outside_rad
    feedback = measured(here_rad)
    outward, limited = apply(MitCommand(here_rad + side, side * 1.0, 100.0, 2.0, 0.0), feedback)
    assert outward.position_rad == here_rad
    assert outward.velocity_rad_s == 0.0
    assert "travel" in limited
    held, limited = apply(pull(here_rad), feedback)
    assert held.position_rad == here_rad  # no force towards the travel that nobody asked for
    assert not limited
    inward, _ = apply(pull(edge_rad - side * 0.5, 100.0), feedback)
    assert (here_rad - inward.position_rad) * side > 0.0


def test_a_velocity_does_not_push_out_of_the_travel_either() -> None:
    feedback = measured(BOUNDS.high_rad + 0.001)
    sent, limited = apply(MitCommand(feedback.position_rad, 3.0, 0.0, 2.0, 0.0), feedback)
    assert sent.velocity_rad_s == 0.0
    assert "travel" in limited


@pytest.mark.parametrize("mount", NOMINAL)
def test_the_travel_is_widened_by_the_overshoot(mount: Geometry) -> None:
    bounds = bounds_of(mount, CONFIG)
    assert bounds.low_rad == pytest.approx(GEOMETRY.open_rad - 0.05 * GEOMETRY.travel_rad)
    assert bounds.high_rad == pytest.approx(GEOMETRY.closed_rad + 0.05 * GEOMETRY.travel_rad)


def test_without_a_calibration_lead_and_torque_are_small() -> None:
    sent, limited = apply(pull(2.0, 500.0), measured(1.0), bounds_of(None, CONFIG))
    assert 0.0 < sent.position_rad - 1.0 <= CONFIG.calib_step_rad
    assert torque_bound_nm(sent, measured(1.0)) <= CONFIG.calib_tau_limit * NEAR
    assert limited == ("travel", "torque")
