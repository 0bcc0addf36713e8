import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.motor import CanFrame
from litegripd.sim.server import SlcanDevice, SlcanResult


def opened() -> SlcanDevice:
    device = SlcanDevice()
    assert device.feed(b"S8\rO\r").reply == b"\r\r"
    return device


def test_the_usual_way_in_and_out() -> None:
    device = SlcanDevice()
    lines = (b"\r\r\r", b"S8\r", b"O\r", b"C\r")
    states = [(device.feed(line).reply, device.is_open) for line in lines]
    assert states == [(b"\r\r\r", False), (b"\r", False), (b"\r", True), (b"\r", False)]


def test_a_data_frame_goes_to_the_bus() -> None:
    result = opened().feed(b"t00880102030405060708\r")
    assert result == SlcanResult(b"z\r", (CanFrame(8, bytes(range(1, 9))),))
    assert opened().feed(b"t7FF0\r") == SlcanResult(b"z\r", (CanFrame(0x7FF, b""),))
    assert opened().feed(b"t7fF1aB\r").frames == (CanFrame(0x7FF, b"\xab"),)


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"T000000081AA\r", b"Z\r"),
        (b"r0088\r", b"z\r"),
        (b"R000000080\r", b"Z\r"),
    ],
)
def test_frames_that_no_motor_understands_are_accepted_and_go_nowhere(
    line: bytes, reply: bytes
) -> None:
    assert opened().feed(line) == SlcanResult(reply, ())


@pytest.mark.parametrize(
    "line",
    [
        b"t0089\r",
        b"t00\r",
        b"t008\r",
        b"t0081A\r",
        b"t00810\r",
        b"t8001AA\r",
        b"t0081AAA\r",
        b"t0081 A\r",
        b"t00x0\r",
        b"r00821122\r",
        b"T200000000\r",
        b"O\r",
        b"S8\r",
        b"s0014\r",
        b"Z1\r",
        b"Q\r",
        b"t0088" + b"0" * 40 + b"\r",
    ],
)
def test_bad_lines_and_bad_moments_are_refused_while_open(line: bytes) -> None:
    assert opened().feed(line) == SlcanResult(b"\a", ())


@pytest.mark.parametrize(
    "line", [b"C\r", b"S9\r", b"S\r", b"s12\r", b"sxyzw\r", b"F\r", b"t0080\r"]
)
def test_bad_lines_and_bad_moments_are_refused_while_closed(line: bytes) -> None:
    assert SlcanDevice().feed(line) == SlcanResult(b"\a", ())


def test_listening_only_sends_nothing() -> None:
    device = SlcanDevice()
    assert device.feed(b"L\r").reply == b"\r"
    assert device.feed(b"t0080\r") == SlcanResult(b"\a", ())
    assert device.encode(CanFrame(0x18, b"\x01"), 0.0) == b"t018101\r"


def test_identification() -> None:
    assert SlcanDevice().feed(b"V\rN\r").reply == b"V1013\rNSIM0\r"
    assert opened().feed(b"F\r").reply == b"F00\r"


def test_reports_carry_a_time_stamp_when_asked_for() -> None:
    device = SlcanDevice()
    device.feed(b"Z1\rs031C\rO\r")
    assert device.encode(CanFrame(0x18, b"\xff"), 61.5) == b"t0181FF05DC\r"
    device.feed(b"C\rZ0\rO\r")
    assert device.encode(CanFrame(0x18, b"\xff"), 61.5) == b"t0181FF\r"


def test_a_closed_channel_reports_nothing() -> None:
    device = opened()
    device.reset()
    assert not device.is_open
    assert device.encode(CanFrame(0x18, b"\xff"), 0.0) == b""


@given(st.binary(max_size=8), st.integers(0, 0x7FF))
def test_what_it_reports_it_also_understands(data: bytes, can_id: int) -> None:
    frame = CanFrame(can_id, data)
    assert opened().feed(opened().encode(frame, 0.0)).frames == (frame,)


HOSTILE = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.text("tTrRSsOLCVNFZ0123456789ABCDEFabcdef\r", max_size=60).map(str.encode),
    ),
    max_size=20,
)


@given(HOSTILE)
def test_no_bytes_ever_raise_and_every_line_is_answered_once(pieces: list[bytes]) -> None:
    device = opened()
    reply = b""
    for piece in pieces:
        result = device.feed(piece)
        reply += result.reply
        for frame in result.frames:
            assert 0 <= frame.can_id <= 0x7FF
            assert len(frame.data) <= 8
    answers = reply.count(b"\r") + reply.count(b"\a")
    assert answers == b"".join(pieces).count(b"\r")


@given(HOSTILE)
def test_pieces_make_no_difference(pieces: list[bytes]) -> None:
    whole, bytewise = opened(), opened()
    at_once = whole.feed(b"".join(pieces))
    single = [bytewise.feed(bytes([byte])) for byte in b"".join(pieces)]
    assert at_once.reply == b"".join(result.reply for result in single)
    assert at_once.frames == tuple(frame for result in single for frame in result.frames)
