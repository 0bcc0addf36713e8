"""Teleoperation on the network: its frames, against bytes laid out by hand, and whom they go to."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.teleop import (
    FORCE_FRAME_BYTES,
    FRAME_BYTES,
    ForceFrame,
    LinkOptions,
    TeleopFrame,
    decode_force,
    decode_frame,
    encode_force,
    encode_frame,
    udp_targets,
)

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NORMAL = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
SMALLEST_NORMAL = 2.2250738585072014e-308
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


@given(NORMAL, NORMAL, FINITE, FINITE)
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


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("value", [5e-324, -5e-324, SMALLEST_NORMAL / 2.0, -SMALLEST_NORMAL / 2.0])
def test_a_subnormal_openness_or_position_is_no_frame(place: int, value: float) -> None:
    values = [0.5, 60.0, 0.0, 0.0]
    values[place] = value
    assert decode_frame(struct.pack(">4d", *values)) is None


@pytest.mark.parametrize("openness", [0.0, 0.25, 0.5, 1.0])
def test_a_frame_in_the_other_byte_order_is_no_frame(openness: float) -> None:
    assert decode_frame(struct.pack("<4d", openness, 36.0, 0.0, 1.5)) is None


def test_zero_the_smallest_normal_and_a_subnormal_force_or_time_are_values() -> None:
    for openness in (0.0, -0.0, SMALLEST_NORMAL, -SMALLEST_NORMAL):
        frame = decode_frame(struct.pack(">4d", openness, 0.0, 5e-324, 5e-324))
        assert frame == TeleopFrame(openness, 0.0, 5e-324, 5e-324)


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


# Force reflection: 40 bytes, and nothing else is one


@given(st.builds(ForceFrame, st.integers(0, 2**64 - 1), FINITE, FINITE, FINITE))
def test_a_force_is_the_same_after_its_journey(frame: ForceFrame) -> None:
    payload = encode_force(frame)
    assert len(payload) == FORCE_FRAME_BYTES == 40
    assert decode_force(payload) == frame
    assert decode_frame(payload) is None


def test_the_bytes_of_a_force_are_as_the_page_describes_them() -> None:
    payload = encode_force(ForceFrame(1, 2.5, 3.0, 4.0))
    assert payload == b"LGFORCE1" + bytes(7) + b"\x01" + struct.pack(">3d", 2.5, 3.0, 4.0)


@given(st.binary(max_size=80))
def test_noise_is_no_force(payload: bytes) -> None:
    assert decode_force(payload) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(3))
def test_a_force_that_is_not_finite_is_neither_sent_nor_read(bad: float, place: int) -> None:
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


# Whom a leader's datagrams go to


@pytest.mark.parametrize(
    ("host", "targets"),
    [
        ("a", [("a", 9)]),
        ("10.0.0.2,10.0.0.3:17449", [("10.0.0.2", 9), ("10.0.0.3", 17449)]),
        ("a:1, b", [("a", 1), ("b", 9)]),
        ("fe80::1", [("fe80::1", 9)]),
        ("[fe80::1]", [("fe80::1", 9)]),
        ("[fe80::1%eth0]:5,b", [("fe80::1%eth0", 5), ("b", 9)]),
    ],
)
def test_hosts_and_their_ports(host: str, targets: list[tuple[str, int]]) -> None:
    assert list(udp_targets(LinkOptions("master", "udp", host, 9))) == targets


@pytest.mark.parametrize(
    "host",
    ["", ",", "a,", "a:", "a:0", "a:65536", "a:x", ":5", "[a:5", "a]", ",".join("abcdefghi")],
)
def test_a_host_that_names_nobody_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match=r"HOST|port|most"):
        udp_targets(LinkOptions("master", "udp", host, 9))
