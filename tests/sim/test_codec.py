import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.motor import CanFrame
from litegripd.sim.registers import (
    Ranges,
    decode_command,
    encode_feedback,
    from_code,
    position_code,
    to_code,
)
from tests.sim.driving import command, decode

GOLDEN = [
    (bytes.fromhex("79DA7FF3336667FF"), {"q": -0.6, "kp": 100.0, "kd": 2.0}),
    (bytes.fromhex("7FFF7FF0000007FF"), {}),
]


@pytest.mark.parametrize(("data", "fields"), GOLDEN)
def test_golden_command_frames_of_the_maker(data: bytes, fields: dict[str, float]) -> None:
    assert command(**fields).data == data
    decoded = decode_command(data, Ranges())
    assert decoded.position_rad == pytest.approx(fields.get("q", 0.0), abs=25 / 65535)
    assert decoded.kp_nm_rad == pytest.approx(fields.get("kp", 0.0), abs=1e-9)
    assert decoded.kd_nm_s_rad == pytest.approx(fields.get("kd", 0.0), abs=1e-9)
    assert -60 / 4095 <= decoded.velocity_rad_s <= 0.0
    assert decoded.torque_nm == pytest.approx(-0.0024, abs=1e-4)


def test_the_ranges_of_the_registers_scale_a_command() -> None:
    data = command(q=12.5, dq=30.0, tau=10.0).data
    decoded = decode_command(data, Ranges(6.0, 45.0, 54.0))
    assert decoded.position_rad == pytest.approx(6.0)
    assert decoded.velocity_rad_s == pytest.approx(45.0)
    assert decoded.torque_nm == pytest.approx(54.0)


@given(st.binary(min_size=8, max_size=8))
def test_every_frame_of_8_bytes_is_a_command_within_the_ranges(data: bytes) -> None:
    decoded = decode_command(data, Ranges())
    assert abs(decoded.position_rad) <= 12.5 + 1e-9
    assert abs(decoded.velocity_rad_s) <= 30.0 + 1e-9
    assert 0.0 <= decoded.kp_nm_rad <= 500.0
    assert 0.0 <= decoded.kd_nm_s_rad <= 5.0
    assert abs(decoded.torque_nm) <= 10.0 + 1e-9


@given(st.floats(-12.5, 12.4999))
def test_codes_truncate_towards_the_low_end(value: float) -> None:
    back = from_code(to_code(value, -12.5, 12.5, 16), -12.5, 12.5, 16)
    assert value - 25 / 65535 - 1e-9 <= back <= value + 1e-9


def test_a_position_beyond_the_range_wraps_and_other_fields_saturate() -> None:
    assert position_code(12.4, 12.5) == to_code(12.4, -12.5, 12.5, 16)
    assert position_code(12.6, 12.5) < 0x200
    assert position_code(-12.6, 12.5) > 0xFE00
    assert to_code(99.0, -30.0, 30.0, 12) == 0xFFF
    assert to_code(-99.0, -30.0, 30.0, 12) == 0


def test_feedback_layout() -> None:
    data = encode_feedback(
        motor_id=0x18, status=0xC, codes=(0x1234, 0x567, 0x89A), driver_c=41.9, coil_c=300.0
    )
    assert data == bytes([0xC8, 0x12, 0x34, 0x56, 0x78, 0x9A, 41, 255])
    feedback = decode(CanFrame(0x18, data))
    assert (feedback.motor_id, feedback.status) == (8, 0xC)
