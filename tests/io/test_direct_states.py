"""The states of the bus that is read in the control thread: what is raised and what comes."""

import errno

import can
import pytest

from tests.io.direct_rig import MESSAGE, Rig, operation_error


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Rig:
    return Rig(monkeypatch)


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


def test_a_flap_that_no_send_has_met_is_over_when_a_frame_can_be_sent(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(operation_error(errno.ENETDOWN, "Network is down"))
    rig.bus.receive(rig.now_s)
    assert rig.state == "link_down"
    rig.bus.receive(rig.now_s)
    assert rig.state == "link_down"  # receiving tells of it only once
    rig.tick()
    assert rig.is_up()


def test_a_frame_tells_that_the_bus_is_up_again(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(operation_error(errno.ENETDOWN))
    rig.bus.receive(rig.now_s)
    assert not rig.is_up()
    rig.fake.to_receive.append(MESSAGE)
    rig.bus.receive(rig.now_s)
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
    rig.bus.receive(rig.now_s)
    assert rig.state == state
    refusal = rig.bus.condition.refusal("can0")
    assert refusal is not None
    assert refusal.data["bus"] == state


@pytest.mark.parametrize(
    ("error", "state", "why"),
    [
        (OSError(errno.ENODEV, "No such device"), "adapter_gone", "no network interface can0"),
        (
            OSError(errno.EAFNOSUPPORT, "no family"),
            "down",
            "no CAN sockets: load them by 'sudo mod",
        ),
        (OSError(errno.EPERM, "Operation not permitted"), "down", "Operation not permitted"),
    ],
)
def test_what_opening_raises_has_a_state_by_name(
    rig: Rig, error: Exception, state: str, why: str
) -> None:
    rig.open_error = error
    rig.tick()
    assert rig.state == state
    assert str(rig.bus.condition.error).startswith("cannot be opened: ")
    assert why in str(rig.bus.condition.error)


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
        assert rig.state == "bus_off"
    rig.fake.to_receive.append(over)
    rig.tick()
    assert rig.state == "up"


def test_bus_off_fills_the_queue_of_an_adapter_and_stays_bus_off(rig: Rig) -> None:
    """As with gs_usb: nothing is sent any more, and what waits for it is no news."""
    rig.tick()
    rig.fake.to_receive.append(error_frame(0x40))
    rig.tick()
    rig.fake.send_error = operation_error(errno.ENOBUFS)
    for _ in range(600):
        rig.tick()
        assert rig.state == "bus_off"
    rig.fake.send_error = operation_error(errno.ENETDOWN)  # somebody sets it down, and up
    rig.tick()
    assert rig.state == "link_down"
    rig.fake.send_error = None
    rig.tick()
    assert rig.is_up()


@pytest.mark.parametrize(
    ("comes", "state"),
    [
        ([MESSAGE, error_frame(0x40)], "bus_off"),
        ([MESSAGE, error_frame(0x40), error_frame(0x08)], "bus_off"),
        ([error_frame(0x40), MESSAGE], "up"),
    ],
)
def test_what_comes_last_in_a_tick_tells_whether_the_bus_is_off(
    rig: Rig, comes: list[can.Message], state: str
) -> None:
    rig.tick()
    rig.fake.to_receive += comes
    assert len(rig.tick()) == 1
    assert rig.state == state


def test_a_queue_that_was_full_before_the_bus_off_does_not_end_it(rig: Rig) -> None:
    rig.tick()
    rig.fake.send_error = operation_error(errno.ENOBUFS)
    for _ in range(300):
        rig.tick()
    assert rig.state == "bus_stalled"
    rig.fake.send_error = None
    rig.fake.to_receive.append(error_frame(0x40))
    rig.tick()
    assert rig.state == "bus_off"


def test_what_has_no_name_lasts_until_a_frame_comes_though_frames_can_be_sent(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(operation_error(None, "something else"))
    for _ in range(10):
        rig.tick()
        assert rig.state == "down"
    rig.fake.to_receive.append(MESSAGE)
    rig.tick()
    assert rig.is_up()


def test_an_error_frame_that_has_the_feedback_id_when_masked_is_no_feedback(rig: Rig) -> None:
    rig.tick()
    rig.fake.to_receive.append(error_frame(0x18))
    assert rig.tick() == []
    assert rig.state == "up"
    assert rig.bus.counters.error_frames == 1
