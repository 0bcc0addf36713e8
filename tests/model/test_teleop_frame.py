"""The frame on the network, against bytes that are laid out by hand."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.teleop_frame import FRAME_BYTES, TeleopFrame, decode_frame, encode_frame

FINITE = st.floats(allow_nan=False, allow_infinity=False)
HALF_OPEN = bytes.fromhex(
    "3fe0000000000000"  # 0.5
    "404e000000000000"  # 60.0
    "c004000000000000"  # -2.5
    "41d954fc40000000"  # 1 700 000 000 s
)


def test_the_bytes_are_four_big_endian_doubles() -> None:
    frame = TeleopFrame(0.5, 60.0, -2.5, 1_700_000_000.0)
    assert len(HALF_OPEN) == FRAME_BYTES == 32
    assert encode_frame(frame) == HALF_OPEN
    assert decode_frame(HALF_OPEN) == frame


@given(FINITE, FINITE, FINITE, FINITE)
def test_every_finite_frame_is_the_same_after_its_journey(
    openness: float, position_mm: float, force_n: float, timestamp_s: float
) -> None:
    frame = TeleopFrame(openness, position_mm, force_n, timestamp_s)
    assert decode_frame(encode_frame(frame)) == frame


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_no_frame(place: int, value: float) -> None:
    values = [0.5, 60.0, 0.0, 1.0]
    values[place] = value
    assert decode_frame(struct.pack(">4d", *values)) is None
    with pytest.raises(ValueError, match="finite"):
        encode_frame(TeleopFrame(*values))


@given(st.binary(max_size=70))
def test_any_bytes_are_a_finite_frame_or_none(payload: bytes) -> None:
    frame = decode_frame(payload)
    if frame is not None:
        assert len(payload) == FRAME_BYTES
        assert math.isfinite(frame.openness + 0.0)


@pytest.mark.parametrize("length", [0, 1, 31, 33, 64])
def test_another_length_is_no_frame(length: int) -> None:
    assert decode_frame(bytes(length)) is None


def test_an_openness_beyond_the_travel_is_a_frame() -> None:
    frame = decode_frame(struct.pack(">4d", 1.25, 0.0, 0.0, 0.0))
    assert frame is not None
    assert frame.openness == 1.25
