"""The bus that is read in the control thread: what python-can raises, and how it recovers."""

import errno
from collections import deque
from itertools import pairwise

import can
import pytest

from litegripd.io import direct_bus
from litegripd.io.bus import MAX_FRAMES_PER_TICK, BusSettings
from litegripd.io.direct_bus import DirectBus
from litegripd.model.frame import CanFrame

FRAME = CanFrame(0x08, bytes(range(8)))
MESSAGE = can.Message(arbitration_id=0x18, data=bytes(8), is_extended_id=False)
SETTINGS = BusSettings("socketcan", "can0", 1_000_000)


class FakeBus:
    """An adapter that gives and raises what a test says."""

    def __init__(self) -> None:
        self.to_receive: deque[can.Message | Exception] = deque()
        self.send_error: Exception | None = None
        self.sent: list[can.Message] = []
        self.is_open = True

    def recv(self, timeout: float) -> can.Message | None:
        assert timeout == 0
        if not self.to_receive:
            return None
        item = self.to_receive.popleft()
        if isinstance(item, Exception):
            raise item
        return item

    def send(self, message: can.Message) -> None:
        if self.send_error is not None:
            raise self.send_error
        self.sent.append(message)

    def shutdown(self) -> None:
        self.is_open = False
        raise can.CanOperationError("gone", error_code=errno.EBADF)


class Rig:
    """A bus on fake adapters; `open_error` makes opening fail."""

    def __init__(self) -> None:
        self.opened: list[FakeBus] = []
        self.open_error: Exception | None = None
        self.now_s = 100.0
        self.bus = DirectBus(SETTINGS)

    def open(self, settings: BusSettings) -> FakeBus:
        assert settings is SETTINGS
        if self.open_error is not None:
            raise self.open_error
        self.opened.append(FakeBus())
        return self.opened[-1]

    def is_up(self) -> bool:
        return self.bus.condition.is_usable

    @property
    def fake(self) -> FakeBus:
        return self.opened[-1]

    def tick(self, after_s: float = 0.005) -> list[CanFrame]:
        self.now_s += after_s
        received = self.bus.receive(self.now_s)
        self.bus.send((FRAME,), self.now_s)
        return received


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Rig:
    made = Rig()
    monkeypatch.setattr(direct_bus, "open_bus", made.open)
    return made


def operation_error(code: int | None, text: str = "failed") -> can.CanOperationError:
    return can.CanOperationError(text, error_code=code)


def test_frames_pass_both_ways(rig: Rig) -> None:
    assert not rig.is_up()
    assert rig.tick() == []
    assert rig.is_up()
    assert [(m.arbitration_id, bytes(m.data)) for m in rig.fake.sent] == [(0x08, FRAME.data)]
    assert not rig.fake.sent[0].is_extended_id
    rig.fake.to_receive += [MESSAGE, MESSAGE]
    assert rig.tick() == [CanFrame(0x18, bytes(8))] * 2
    counters = rig.bus.counters
    assert (counters.sent, counters.received, counters.reopened) == (2, 2, 0)
    assert counters.bits == pytest.approx(4 * 111 * 1.1)


def test_what_is_no_classic_data_frame_is_ignored_and_counted(rig: Rig) -> None:
    rig.tick()
    kinds = ("is_remote_frame", "is_extended_id", "is_fd")
    for kind in kinds:
        flags = {"is_extended_id": False, kind: True}
        rig.fake.to_receive.append(can.Message(arbitration_id=0x18, **flags))
    rig.fake.to_receive.append(MESSAGE)
    assert rig.tick() == [CanFrame(0x18, bytes(8))]
    assert rig.bus.counters.ignored == len(kinds)
    assert rig.is_up()


def test_one_tick_reads_a_bounded_number_of_frames(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive += [MESSAGE] * (MAX_FRAMES_PER_TICK + 3)
    assert len(rig.tick()) == MAX_FRAMES_PER_TICK
    assert len(rig.tick()) == 3


def test_the_newest_frame_of_a_full_bus_is_read_in_the_longest_period(rig: Rig) -> None:
    shortest_frame_s, longest_period_s = 47e-6, 0.01
    newest = can.Message(arbitration_id=0x18, data=b"newest", is_extended_id=False)
    rig.tick()
    rig.fake.to_receive += [MESSAGE] * int(longest_period_s / shortest_frame_s)
    rig.fake.to_receive.append(newest)
    assert rig.tick()[-1].data == b"newest"


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENODEV, "No such device"),
        OSError(errno.EAFNOSUPPORT, "Address family not supported"),
        can.CanInterfaceNotImplementedError("unknown interface"),
        TypeError("unexpected keyword"),
        AttributeError("anything"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_tried_again_ever_less_often(
    rig: Rig, error: Exception
) -> None:
    rig.open_error = error
    attempts: list[float] = []
    original = rig.bus._reopen_at_s
    for _ in range(5000):
        rig.tick()
        if rig.bus._reopen_at_s != original:
            attempts.append(rig.now_s)
            original = rig.bus._reopen_at_s
    assert not rig.is_up()
    assert rig.bus.condition.error is not None
    assert rig.bus.condition.error.startswith("cannot be opened")
    assert str(error.args[-1]) in rig.bus.condition.error
    gaps = [later - earlier for earlier, later in pairwise(attempts)]
    assert gaps[:5] == pytest.approx([0.5, 1.0, 2.0, 4.0, 5.0], abs=0.01)
    assert rig.bus.counters.send_failures == 5000
    rig.open_error = None
    rig.tick(5.0)
    assert rig.is_up()


def test_a_link_that_is_down_comes_back_on_the_same_socket(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(operation_error(errno.ENETDOWN, "Network is down"))
    rig.fake.send_error = operation_error(errno.ENETDOWN, "Network is down")
    rig.tick()
    assert rig.bus.condition.error == "Network is down [Error Code 100] (error 100)"
    rig.tick()
    assert not rig.is_up()
    rig.fake.send_error = None
    rig.tick()  # a motor without power does not answer, but the bus is up
    assert rig.is_up()
    assert len(rig.opened) == 1


def test_a_frame_tells_that_the_bus_is_up_again(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(operation_error(errno.ENETDOWN))
    rig.bus.receive(rig.now_s)
    assert not rig.is_up()
    rig.fake.to_receive.append(MESSAGE)
    rig.bus.receive(rig.now_s)
    assert rig.is_up()


@pytest.mark.parametrize(
    "error",
    [
        operation_error(errno.ENODEV),
        operation_error(errno.EBADF),
        OSError(errno.ENODEV, "No such device"),
        ValueError("file descriptor cannot be a negative integer (-1)"),
    ],
)
def test_an_adapter_that_is_gone_is_closed_and_opened_again(rig: Rig, error: Exception) -> None:
    rig.tick()
    gone = rig.fake
    gone.to_receive += [MESSAGE, error]
    assert rig.tick() == [CanFrame(0x18, bytes(8))]
    assert not gone.is_open
    assert not rig.is_up()
    rig.tick(0.4)
    assert not rig.is_up()
    assert len(rig.opened) == 1
    rig.tick(0.2)
    assert rig.is_up()
    assert len(rig.opened) == 2
    assert rig.bus.counters.reopened == 1
    assert rig.bus.counters.errors == 1


def test_an_adapter_that_is_gone_is_noticed_in_sending_too(rig: Rig) -> None:
    rig.tick()
    rig.fake.send_error = operation_error(errno.ENXIO)
    rig.tick()
    assert not rig.is_up()
    assert not rig.fake.is_open
    rig.tick(0.6)
    assert rig.is_up()


@pytest.mark.parametrize(
    "error", [operation_error(errno.ENOBUFS), operation_error(None, "Transmit buffer full")]
)
def test_a_full_queue_is_transient_unless_it_lasts(rig: Rig, error: Exception) -> None:
    rig.tick()
    rig.fake.send_error = error
    for _ in range(150):
        rig.tick()
    assert rig.is_up()
    assert rig.bus.counters.send_failures == 150
    for _ in range(60):
        rig.tick()
    assert rig.bus.condition.error is not None
    assert "acknowledges" in rig.bus.condition.error
    rig.fake.send_error = None
    rig.tick()
    assert rig.is_up()
    rig.fake.send_error = error
    rig.tick()
    assert rig.is_up()
    assert len(rig.opened) == 1


@pytest.mark.parametrize(
    ("error", "state"),
    [
        (operation_error(errno.ENETDOWN, "Network is down"), "link_down"),
        (operation_error(errno.ENODEV), "adapter_gone"),
        (operation_error(errno.ENXIO), "adapter_gone"),
        (operation_error(errno.EBADF), "adapter_gone"),
        (operation_error(None, "something else"), "down"),
        (ValueError("file descriptor cannot be a negative integer (-1)"), "down"),
    ],
)
def test_what_is_raised_has_a_state_by_name(rig: Rig, error: Exception, state: str) -> None:
    rig.tick()
    rig.fake.to_receive.append(error)
    rig.tick()
    assert rig.bus.condition.state == state
    refusal = rig.bus.condition.refusal()
    assert refusal is not None
    assert refusal.data["bus"] == state


@pytest.mark.parametrize(
    ("error", "state"),
    [(OSError(errno.ENODEV, "No such device"), "adapter_gone"), (OSError(97, "no CAN"), "down")],
)
def test_what_opening_raises_has_a_state_by_name(rig: Rig, error: Exception, state: str) -> None:
    rig.open_error = error
    rig.tick()
    assert rig.bus.condition.state == state


def error_frame(kind: int) -> can.Message:
    return can.Message(
        arbitration_id=kind, is_error_frame=True, is_extended_id=False, data=bytes(8)
    )


@pytest.mark.parametrize("over", [MESSAGE, error_frame(0x100)])
def test_bus_off_lasts_until_something_comes_though_frames_can_be_sent(
    rig: Rig, over: can.Message
) -> None:
    rig.tick()
    rig.fake.to_receive.append(error_frame(0x40))
    for _ in range(10):
        rig.tick()
        assert rig.bus.condition.state == "bus_off"
    rig.fake.to_receive.append(over)
    rig.tick()
    assert rig.bus.condition.state == "up"


def test_an_error_frame_that_has_the_feedback_id_when_masked_is_no_feedback(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(error_frame(0x18))
    assert rig.tick() == []
    assert rig.bus.condition.state == "up"
    assert rig.bus.counters.error_frames == 1


def test_closing_an_adapter_that_is_gone_does_not_matter(rig: Rig) -> None:
    rig.tick()
    rig.bus.close()
    assert not rig.fake.is_open
    rig.bus.close()


def test_nothing_is_sent_behind_a_frame_that_failed(rig: Rig) -> None:
    """An enable frame without the zero-gain frame before it could make the jaws jump."""
    rig.tick()
    fake = rig.fake
    before = len(fake.sent)
    refused = can.CanOperationError("Transmit buffer full", error_code=errno.ENOBUFS)

    def send_but_the_first(message: can.Message) -> None:
        fake.sent.append(message)
        if len(fake.sent) == before + 1:
            raise refused

    fake.send = send_but_the_first  # type: ignore[method-assign]
    failures = rig.bus.counters.send_failures
    rig.bus.send((FRAME, FRAME, FRAME), rig.now_s)
    assert len(fake.sent) == before + 1
    assert rig.bus.counters.send_failures == failures + 3
