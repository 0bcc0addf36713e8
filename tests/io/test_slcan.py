"""What an SLCAN adapter sends: frames out of damage, and who is no SLCAN adapter at all."""

import os
import random
import subprocess
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.io.can import slcan
from litegripd.io.can.slcan import AdapterLines
from litegripd.model.motor import CanFrame
from tests.io.test_pumped_bus import Rig

GOOD = b"t018811222233AABB1E20\r"
FRAME = CanFrame(0x18, bytes.fromhex("11222233AABB1E20"))
COMMANDS = frozenset({b"C", b"S8", b"O", b"V"})


def lines() -> AdapterLines:
    return AdapterLines(COMMANDS, 0.0)


def taken(one: AdapterLines, data: bytes, now_s: float = 0.0) -> list[CanFrame]:
    return list(one.take(data, now_s))


@pytest.mark.parametrize(
    "line",
    [
        GOOD,
        b"\n" + GOOD,
        GOOD[:-1] + b"\n",
        GOOD[:-1] + b"12AB\r",
        b"\0" + GOOD,
        GOOD.lower(),
        b"z\r" + GOOD,
    ],
    ids=["plain", "CR LF", "LF", "time stamp", "zero", "small letters", "after an answer"],
)
def test_a_frame_is_read_however_the_adapter_writes_it(line: bytes) -> None:
    one = lines()
    assert taken(one, line) == [FRAME]
    assert one.ignored == 0


@pytest.mark.parametrize(
    "line",
    [
        b"t0188\xb111222233AABB1E20\r",
        GOOD[:-3] + b"\r",  # a digit short
        GOOD[:-5] + b"\r",  # a byte short: no shorter frame
        b"t0189" + GOOD[5:],
        b"t918811222233AABB1E20\r",  # no id of 11 bits
        b"t01881122 233AABB1E20\r",
        b"\xff" * 8 + b"\r",
    ],
)
def test_a_damaged_line_is_counted_and_costs_its_own_frame_alone(line: bytes) -> None:
    one = lines()
    assert taken(one, GOOD + line + GOOD) == [FRAME, FRAME]
    assert one.ignored == 1


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_any_bytes_in_any_pieces_are_read_without_an_error(pieces: list[bytes]) -> None:
    one, whole = lines(), lines()
    in_pieces = [frame for piece in pieces for frame in taken(one, piece)]
    assert in_pieces == taken(whole, b"".join(pieces))
    assert taken(one, b"\r" + GOOD)[-1] == FRAME


def test_a_million_damaged_bytes_cost_no_frame_between_them_and_no_verdict() -> None:
    one, chance = lines(), random.Random(1)
    for number in range(10_000):
        noise = chance.randbytes(100).replace(b"t", b"u")
        assert taken(one, noise + b"\r" + GOOD, 0.005 * number)[-1] == FRAME
        assert one.verdict(0.005 * number) is None
        assert len(one._rest) <= 256


def test_bytes_without_an_end_of_line_do_not_pile_up() -> None:
    one = lines()
    for _ in range(1000):
        taken(one, b"x" * 100)
        assert len(one._rest) <= 256


def test_frames_of_another_kind_are_counted_and_are_nothing_strange() -> None:
    one = lines()
    assert taken(one, b"T0000001881122334455667788\rr0188\rd018F00\r" * 30) == []
    assert one.ignored == 90
    assert one.verdict(60.0) is None


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"\r\nERROR\r\n" * 30, "does not speak SLCAN"),
        (random.Random(2).randbytes(9000), "does not speak SLCAN"),
        (b"C\rS8\r\rO\rO\rV\r", "returns what is sent"),
        (b"\a" * 30, "refuses"),
    ],
    ids=["modem", "binary", "echo", "refuses all"],
)
def test_what_is_no_adapter_is_named(data: bytes, why: str) -> None:
    one = lines()
    assert taken(one, data) == []
    assert why in (one.verdict(1.0) or "")


def test_the_answers_of_an_adapter_are_no_reason_for_a_verdict() -> None:
    one = lines()
    taken(one, b"\r\r\a\rV1013\r" + b"z\r" * 1000 + b"N1234\rF00\r")
    assert (one.ignored, one.doubt(60.0), one.verdict(60.0)) == (0, "", None)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "nothing has come"),
        (b"\r\a\r\r\aV1013\r", "refuses 1 Mbit/s"),
        (b"\a\a\r\aV1013\r", "refuses 1 Mbit/s"),
        (b"\a\r\a\a\aV1013\r", "refuses to open the bus"),
        (b"\r\r\a\av0101\r", "refuses to open the bus"),
        (b"\xf1\x00\x01\x02" * 8, "does not speak SLCAN"),
        (b"\0" * 40, "does not speak SLCAN"),
        (b"echo:Unknown command\nok\n", "does not speak SLCAN"),
    ],
)
def test_an_adapter_of_no_use_is_doubted_until_a_frame_comes(data: bytes, why: str) -> None:
    one = lines()
    assert taken(one, data) == []
    assert why in one.doubt(1.0)
    assert one.verdict(1.0) is None
    taken(one, b"\r" + GOOD)
    assert one.doubt(1.0) == ""


@pytest.mark.parametrize("data", [b"\r\r\r\r\aV1013\r", b"\a\r\a\r\aV1013\r", b"V1\r", b"\a\a\r"])
def test_what_an_adapter_answers_to_its_opening_is_not_doubted(data: bytes) -> None:
    one = lines()
    taken(one, data + b"z\r" * 5)
    assert one.doubt(60.0) == ""
    one = lines()
    taken(one, b"\a\r\a\a\a")
    assert one.doubt(0.5) == ""  # its version may yet come


def test_nothing_but_zeros_is_no_adapter() -> None:
    """As a line gives at a wrong baud rate, or one that is held low."""
    one = lines()
    for _ in range(100):
        taken(one, b"\0" * 100)
    assert one.ignored > 20
    assert "does not speak SLCAN" in (one.verdict(1.0) or "")


def test_refusals_between_frames_that_were_sent_are_no_verdict() -> None:
    one = lines()
    for _ in range(100):
        taken(one, b"\a\az\r")
        assert one.verdict(1.0) is None


def test_an_adapter_that_worked_is_opened_again_only_after_seconds_of_damage() -> None:
    one = lines()
    taken(one, GOOD, 10.0)
    taken(one, b"garbage\r" * 100, 10.1)
    assert one.verdict(14.9) is None
    assert "nothing but damage for 5 s" in (one.verdict(15.0) or "")
    taken(one, GOOD, 15.1)
    assert one.verdict(15.1) is None


class Line:
    """A pseudo-terminal; `device` is the path for the daemon's side."""

    def __init__(self) -> None:
        self.adapter, self._device_fd = os.openpty()
        tty.setraw(self.adapter)
        tty.setraw(self._device_fd)
        self.device = os.ttyname(self._device_fd)
        self._ends = False
        self._thread = threading.Thread(target=self._answer)
        self.answer = b""
        """What is sent back for each piece that the daemon's side has sent; None: that itself."""
        self.echoes = False

    def begin(self) -> None:
        self._thread.start()

    def send(self, data: bytes) -> None:
        os.write(self.adapter, data)

    def _answer(self) -> None:
        while not self._ends:
            try:
                data = os.read(self.adapter, 4096)
            except OSError:
                return
            if not self._ends and (self.echoes or self.answer):
                os.write(self.adapter, data if self.echoes else self.answer)

    def close(self) -> None:
        self._ends = True
        os.write(self._device_fd, b"\r")  # so that the reading ends
        self._thread.join()
        os.close(self._device_fd)
        os.close(self.adapter)


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.close()


@pytest.fixture
def rig(line: Line) -> Iterator[Rig]:
    made = Rig(line.device)
    yield made
    made.bus.close()


def test_a_byte_of_noise_leaves_the_adapter_open(line: Line, rig: Rig) -> None:
    line.begin()
    rig.until(lambda: rig.bus.condition.state == "up")
    line.send(GOOD + b"t0188\xb11222233AABB1E20\r" + GOOD)
    rig.until(lambda: rig.bus.counters.received == 2 and rig.bus.counters.ignored == 1)
    assert rig.bus.counters.reopened == 0
    assert rig.bus.condition.state == "up"


@pytest.mark.parametrize(
    ("answer", "echoes", "why"),
    [(b"\r\nERROR\r\n" * 30, False, "does not speak SLCAN"), (b"", True, "returns what is sent")],
    ids=["modem", "echo"],
)
def test_a_port_that_is_no_adapter_is_named_and_opened_again(
    line: Line, rig: Rig, answer: bytes, echoes: bool, why: str
) -> None:
    line.answer, line.echoes = answer, echoes
    line.begin()
    rig.until(lambda: why in (rig.bus.condition.error or ""))
    assert rig.bus.condition.state == "down"


def test_a_mute_port_is_doubted_until_something_comes(line: Line, rig: Rig) -> None:
    line.begin()
    rig.until(lambda: "nothing has come" in (rig.bus.condition.error or ""))
    assert rig.bus.condition.state == "up"
    line.send(GOOD)
    rig.until(lambda: "nothing has come" not in (rig.bus.condition.error or ""))


def test_a_program_that_takes_all_that_comes_is_named(line: Line, rig: Rig) -> None:
    """Nothing is damaged then: nothing comes at all."""
    line.begin()
    rig.until(lambda: f"(pid {os.getpid()})" in (rig.bus.condition.error or ""))
    assert "nothing has come" in (rig.bus.condition.error or "")
    assert rig.bus.counters.ignored == 0


def test_another_program_at_the_port_is_named_when_lines_are_damaged(line: Line, rig: Rig) -> None:
    line.begin()
    rig.until(lambda: rig.bus.condition.state == "up")
    line.send(b"t0188AABB1E20\r" + GOOD)  # as where another one has taken some bytes
    rig.until(lambda: f"(pid {os.getpid()})" in (rig.bus.condition.error or ""))
    assert rig.bus.condition.state == "up"


@pytest.mark.parametrize("channel", ["/dev/ttyACM0@fast", "/dev/ttyACM0@", "/dev/ttyACM0@1e6"])
def test_a_baud_rate_that_is_none_is_named(channel: str) -> None:
    with pytest.raises(ValueError, match="must be the adapter's baud rate"):
        slcan.SlcanBus(channel)


def test_a_program_that_has_a_file_open_is_found_and_oneself_is_not(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.touch()
    with path.open(encoding="utf-8") as opened:
        assert slcan.holders(str(path)) == []
        with subprocess.Popen(["cat"], stdin=subprocess.PIPE, pass_fds=[opened.fileno()]) as cat:
            assert slcan.holders(str(path)) == [f"cat (pid {cat.pid})"]
