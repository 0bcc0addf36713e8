"""The bus that is read in the control thread: what passes, what is lost, how it is opened again."""

import errno
from itertools import pairwise

import can
import pytest

from litegripd.io.can.bus import MAX_FRAMES_PER_TICK
from litegripd.model.motor import CanFrame
from tests.io.direct_rig import FRAME, MESSAGE, Rig, operation_error


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Rig:
    return Rig(monkeypatch)


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
    assert rig.bus.counters.send_failures == 0  # what was never open has lost nothing
    rig.open_error = None
    rig.tick(5.0)
    assert rig.is_up()
    assert rig.bus.counters.reopened == 0
    rig.fake.to_receive.append(operation_error(errno.ENODEV))
    rig.tick()
    assert rig.bus.counters.send_failures == 1


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
