"""Command and feedback frames: exact bytes, rounding, refusals, and no other exception."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from litegripd.model.gripper import DM4310, DM4340, MOTOR_TYPES
from litegripd.model.motor import MitCommand, Ranges
from litegripd.motor import codec
from litegripd.sim import registers as sim_codec

RANGES = DM4310.ranges
LSB_12 = 1.0 / 4095
GOLDEN = [  # published by the maker, which truncates; then what rounding to the nearest gives
    (MitCommand(-0.6, 0.0, 100.0, 2.0, 0.0), "79DA7FF3336667FF", "79DB800333666800"),
    (MitCommand(0.0, 0.0, 0.0, 0.0, 0.0), "7FFF7FF0000007FF", "8000800000000800"),
]

span = st.floats(0.125, 100.0, width=32)  # as a register holds it
of_a_type = st.sampled_from([row.ranges for row in MOTOR_TYPES.values()])
ranges = of_a_type | st.builds(Ranges, span, span, span)
shares = st.floats(-1.0, 1.0)


def codes(data: bytes) -> tuple[int, ...]:
    word = int.from_bytes(data, "big")
    return (word >> 48, word >> 36 & 0xFFF, word >> 24 & 0xFFF, word >> 12 & 0xFFF, word & 0xFFF)


@pytest.mark.parametrize(("command", "makers", "ours"), GOLDEN)
def test_golden_frames(command: MitCommand, makers: str, ours: str) -> None:
    encoded = codec.encode_command(command, RANGES)
    assert encoded.hex().upper() == ours
    theirs = codes(bytes.fromhex(makers))
    assert all(0 <= a - b <= 1 for a, b in zip(codes(encoded), theirs, strict=True))
    decoded = codec.decode_command(bytes.fromhex(makers), RANGES)
    assert decoded.position_rad == pytest.approx(command.position_rad, abs=25.0 / 65535)
    assert decoded.kp_nm_rad == pytest.approx(command.kp_nm_rad, abs=500.0 * LSB_12)
    assert decoded.kd_nm_s_rad == pytest.approx(command.kd_nm_s_rad, abs=5.0 * LSB_12)


def test_the_same_bytes_mean_something_else_to_another_type() -> None:
    """A quarter above the middle of speed and torque: 5 rad/s and 14 N·m of a DM4340."""
    data = codec.encode_command(MitCommand(-0.6, 5.0, 100.0, 2.0, 14.0), DM4340.ranges)
    assert data.hex().upper() == "79DBBFF333666BFF"
    usual = codec.decode_command(data, DM4310.ranges)
    assert usual.velocity_rad_s == pytest.approx(15.0, abs=0.02)
    assert usual.torque_nm == pytest.approx(5.0, abs=0.01)


@given(of_a_type, shares, shares, shares)
def test_the_simulated_firmware_reads_what_the_daemon_writes(
    spans: Ranges, q: float, dq: float, tau: float
) -> None:
    """Two codecs that share no code."""
    command = MitCommand(
        q * spans.position_rad, dq * spans.velocity_rad_s, 100.0, 2.0, tau * spans.torque_nm
    )
    firmware = sim_codec.Ranges(spans.position_rad, spans.velocity_rad_s, spans.torque_nm)
    read = sim_codec.decode_command(codec.encode_command(command, spans), firmware)
    assert read.position_rad == pytest.approx(command.position_rad, abs=spans.position_rad / 65000)
    speed = command.velocity_rad_s
    assert read.velocity_rad_s == pytest.approx(speed, abs=spans.velocity_rad_s / 4000)
    assert read.torque_nm == pytest.approx(command.torque_nm, abs=spans.torque_nm / 4000)


def test_zero_torque_is_as_near_as_the_codes_allow() -> None:
    data = codec.encode_command(MitCommand(0.0, 0.0, 0.0, 0.0, 0.0), RANGES)
    assert 0.0 < abs(codec.decode_command(data, RANGES).torque_nm) < 0.00245


def test_the_encoder_rounds_and_does_not_truncate() -> None:
    lsb_nm = 20.0 / 4095
    middle = codec.decode_command(bytes(6) + b"\x08\x00", RANGES).torque_nm
    for offset, code in ((-0.6, 0x7FF), (-0.4, 0x800), (0.4, 0x800), (0.6, 0x801)):
        command = MitCommand(0.0, 0.0, 0.0, 0.0, middle + offset * lsb_nm)
        assert codes(codec.encode_command(command, RANGES))[4] == code


@given(ranges, shares, shares, st.floats(0.0, 500.0), st.floats(0.0, 5.0), shares)
def test_a_command_comes_back_within_half_a_code(
    spans: Ranges, q: float, dq: float, kp: float, kd: float, tau: float
) -> None:
    command = MitCommand(
        q * spans.position_rad, dq * spans.velocity_rad_s, kp, kd, tau * spans.torque_nm
    )
    back = codec.decode_command(codec.encode_command(command, spans), spans)
    half = 0.5 + 1e-6
    assert abs(back.position_rad - command.position_rad) <= half * 2 * spans.position_rad / 65535
    assert abs(back.velocity_rad_s - command.velocity_rad_s) <= half * 2 * (
        spans.velocity_rad_s * LSB_12
    )
    assert abs(back.kp_nm_rad - kp) <= half * 500.0 * LSB_12
    assert abs(back.kd_nm_s_rad - kd) <= half * 5.0 * LSB_12
    assert abs(back.torque_nm - command.torque_nm) <= half * 2 * spans.torque_nm * LSB_12


@given(ranges, st.binary(min_size=8, max_size=8))
def test_what_is_decoded_can_be_encoded_again_to_the_same_bytes(spans: Ranges, data: bytes) -> None:
    assert codec.encode_command(codec.decode_command(data, spans), spans) == data


@given(ranges, st.binary(min_size=8, max_size=8))
@example(Ranges(72.76836933582672, 72.76836933582672, 72.76836933582672), b"\xff" * 8)
def test_measured_values_lie_within_the_ranges(spans: Ranges, data: bytes) -> None:
    """Also by no rounding error: a held position is encoded again, and the encoder refuses."""
    feedback = codec.decode_feedback(data, spans, 0.0)
    assert abs(feedback.position_rad) <= spans.position_rad
    assert abs(feedback.velocity_rad_s) <= spans.velocity_rad_s
    assert abs(feedback.torque_nm) <= spans.torque_nm


@pytest.mark.parametrize("field", range(5))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9, -1e9])
def test_a_value_that_no_code_means_is_refused_by_name(field: int, bad: float) -> None:
    values = [0.0] * 5
    values[field] = bad
    name = ("position_rad", "velocity_rad_s", "kp_nm_rad", "kd_nm_s_rad", "torque_nm")[field]
    with pytest.raises(ValueError, match=name):
        codec.encode_command(MitCommand(*values), RANGES)


@pytest.mark.parametrize(("field", "limit"), list(enumerate([12.5, 30.0, 500.0, 5.0, 10.0])))
def test_the_ends_of_a_range_are_allowed_and_nothing_beyond(field: int, limit: float) -> None:
    values = [0.0] * 5
    values[field] = limit
    all_ones = 0xFFFF if field == 0 else 0xFFF
    assert codes(codec.encode_command(MitCommand(*values), RANGES))[field] == all_ones
    values[field] = math.nextafter(limit, math.inf)
    with pytest.raises(ValueError, match="must be"):
        codec.encode_command(MitCommand(*values), RANGES)


def test_negative_gains_are_refused() -> None:
    for command in (MitCommand(0, 0, -0.1, 0, 0), MitCommand(0, 0, 0, -0.1, 0)):
        with pytest.raises(ValueError, match="0 to"):
            codec.encode_command(command, RANGES)


def test_a_feedback_frame_is_read_field_by_field() -> None:
    feedback = codec.decode_feedback(bytes.fromhex("188000FFF00041 2D".replace(" ", "")), RANGES, 7)
    assert feedback.status == 1
    assert feedback.position_rad == pytest.approx(25.0 / 65535 / 2)
    assert feedback.velocity_rad_s == 30.0
    assert feedback.torque_nm == -10.0
    assert (feedback.driver_temperature_c, feedback.coil_temperature_c) == (0x41, 0x2D)
    assert feedback.at_s == 7


@given(st.binary(max_size=12))
def test_decoding_any_bytes_raises_nothing_but_value_error(data: bytes) -> None:
    if len(data) == 8:
        codec.decode_command(data, RANGES)
        assert 0 <= codec.decode_feedback(data, RANGES, 0.0).status <= 15
        return
    with pytest.raises(ValueError, match="8 bytes"):
        codec.decode_command(data, RANGES)
    with pytest.raises(ValueError, match="8 bytes"):
        codec.decode_feedback(data, RANGES, 0.0)


def test_special_frames_are_the_makers() -> None:
    frames = (codec.ENABLE, codec.DISABLE, codec.SET_ZERO, codec.CLEAR_FAULT)
    assert [frame.hex() for frame in frames] == ["ff" * 7 + end for end in ("fc", "fd", "fe", "fb")]


@given(st.binary(max_size=9))
def test_feedback_of_another_motor_is_told_by_the_id_nibble(data: bytes) -> None:
    expected = len(data) == 8 and data[0] % 16 == 8
    assert codec.is_from_motor(data, 0x08) is expected
