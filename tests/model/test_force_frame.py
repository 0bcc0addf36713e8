"""The frame of force reflection: 40 bytes, and nothing else is one."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.teleop import (
    FORCE_FRAME_BYTES,
    FRAME_BYTES,
    ForceFrame,
    decode_force,
    decode_frame,
    encode_force,
)

numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(st.builds(ForceFrame, st.integers(0, 2**64 - 1), numbers, numbers, numbers))
def test_frames_are_the_same_after_their_journey(frame: ForceFrame) -> None:
    payload = encode_force(frame)
    assert len(payload) == FORCE_FRAME_BYTES == 40
    assert decode_force(payload) == frame
    assert decode_frame(payload) is None


def test_the_bytes_are_as_the_page_describes_them() -> None:
    payload = encode_force(ForceFrame(1, 2.5, 3.0, 4.0))
    assert payload == b"LGFORCE1" + bytes(7) + b"\x01" + struct.pack(">3d", 2.5, 3.0, 4.0)


@given(st.binary(max_size=80))
def test_noise_is_no_frame(payload: bytes) -> None:
    assert decode_force(payload) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(3))
def test_what_is_not_finite_is_neither_sent_nor_read(bad: float, place: int) -> None:
    values = [1.0, 2.0, 3.0]
    values[place] = bad
    assert decode_force(struct.pack(">8sQ3d", b"LGFORCE1", 1, *values)) is None
    with pytest.raises(ValueError, match="finite"):
        encode_force(ForceFrame(1, *values))


def test_another_mark_or_sender_is_refused() -> None:
    assert decode_force(struct.pack(">8sQ3d", b"LGFORCE2", 1, 1.0, 1.0, 1.0)) is None
    with pytest.raises(ValueError, match="sender"):
        encode_force(ForceFrame(2**64, 1.0, 1.0, 1.0))


def test_a_leaders_frame_is_no_force() -> None:
    assert decode_force(bytes(FRAME_BYTES)) is None
