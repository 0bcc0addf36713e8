"""A wrong bit rate, or a mode in which no motor answers, is read at each link-up and named."""

import logging
import socket
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_client.socketcan import link as can_link
from litegripd.app import helper_main
from litegripd.app.build import LinkWatch
from litegripd.model.motor import UP, BusCondition, BusSettings
from litegripd.model.state import TaskResult
from tests.world import World

DOWN = BusCondition("link_down", "the link is down")
STALLED = BusCondition("bus_stalled", "no frame can be sent, since nobody acknowledges any")
RIGHT: dict[str, Any] = {"bitrate": 1_000_000, "ifindex": 3, "modes": {}, "set_by": []}
SLOW: dict[str, Any] = {**RIGHT, "bitrate": 500_000}
FILE = "/etc/systemd/network/can.network:5 (systemd-networkd) sets 0.5 Mbit/s"
MEND = "sudo ip link set can0 down && sudo ip link set can0 up type can bitrate 1000000"


def watch(interface: str = "socketcan") -> LinkWatch:
    return LinkWatch(BusSettings(interface, "can0", 1_000_000))


def looked(watching: LinkWatch, found: dict[str, Any]) -> LinkWatch:
    """Answer the look of a link-up."""
    task = watching.step(UP)
    assert task is not None
    assert (task.operation, task.parameters) == ("link.look", {"channel": "can0"})
    task.on_result(TaskResult(found))
    return watching


def test_it_is_read_once_at_each_link_up() -> None:
    watching = watch()
    assert watching.step(BusCondition("down", "not opened yet")) is None
    looked(watching, RIGHT)
    for condition in (UP, STALLED, BusCondition("bus_off", "x"), UP):
        assert watching.step(condition) is None
    assert (watching.bitrate, watching.doubt) == (1_000_000, None)
    assert watching.step(DOWN) is None
    assert watching.bitrate is None
    looked(watching, SLOW)
    assert watching.bitrate == 500_000


def test_a_wrong_rate_is_told_with_who_sets_it_and_what_corrects_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    watching = looked(watch(), {**SLOW, "set_by": [FILE]})
    said = (
        "can0 runs at 0.5 Mbit/s, and the motor speaks at 1 Mbit/s, and again at every plug:"
        f" {FILE}; to correct it: {MEND}"
    )
    assert [one.getMessage() for one in caplog.records] == [said]
    assert caplog.records[0].levelno == logging.WARNING
    assert watching.judged(UP) == BusCondition("up", said)
    assert watching.judged(STALLED) == BusCondition("bus_stalled", f"{said}; {STALLED.error}")
    assert watching.judged(DOWN) == DOWN
    watching.step(DOWN)
    assert watching.judged(UP) == UP


def test_a_mode_is_told_and_switched_off() -> None:
    modes = {"listen-only": "the adapter only listens"}
    doubt = looked(watch(), {**RIGHT, "modes": modes}).doubt
    assert doubt is not None
    assert "can0 has listen-only on (the adapter only listens)" in doubt
    assert doubt.endswith(f"{MEND} listen-only off")


def test_what_is_not_known_is_not_doubted() -> None:
    watching = watch()
    task = watching.step(UP)
    assert task is not None
    task.on_result(TaskResult(None, "IpError: ip (iproute2) is not installed"))
    assert (watching.bitrate, watching.doubt) == (None, None)
    assert looked(watch(), {**RIGHT, "bitrate": None}).doubt is None


def test_an_answer_that_comes_after_the_link_was_lost_does_not_count() -> None:
    watching = watch()
    task = watching.step(UP)
    assert task is not None
    watching.step(DOWN)
    task.on_result(TaskResult(SLOW))
    assert (watching.bitrate, watching.doubt) == (None, None)


@pytest.mark.parametrize("interface", ["slcan", "virtual", "litegrip_sim", "pcan"])
def test_an_adapter_that_is_no_network_interface_has_none(interface: str) -> None:
    assert watch(interface).step(UP) is None


def test_the_helper_asks_the_kernel() -> None:
    assert helper_main.OPERATIONS["link.look"]({"channel": "lo"}) == {
        **RIGHT,
        "bitrate": None,
        "ifindex": socket.if_nametoindex("lo"),
    }
    with pytest.raises(OSError, match="no network interface nothere9"):
        helper_main.OPERATIONS["link.look"]({"channel": "nothere9"})


def attribute(kind: int, value: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(value), kind) + value + bytes(-len(value) % 4)


@pytest.mark.parametrize(("bits", "modes"), [(0, ()), (0x2, ("LISTEN-ONLY",)),
    (0x31, ("LOOPBACK", "BERR-REPORTING", "FD"))])  # fmt: skip
def test_what_the_kernel_answers_is_read(bits: int, modes: tuple[str, ...]) -> None:
    data = attribute(1, struct.pack("=8I", 500_000, *range(7)))
    data += attribute(5, struct.pack("=II", 0xFFFF, bits))
    info = attribute(1, b"can\0") + attribute(2, data)
    body = struct.pack("=BxHiII", 0, 280, 3, 1, 0)
    body += attribute(3, b"can0\0") + attribute(18 | 0x8000, info)
    message = struct.pack("=IHHII", 16 + len(body), 16, 0, 1, 0) + body
    assert can_link.from_netlink(message) == can_link.Link(
        "can0", is_can=True, is_up=True, kind="can", bitrate=500_000, index=3, modes=modes
    )
    for end in range(len(message)):
        can_link.from_netlink(message[:end])


@given(st.binary(max_size=200))
def test_whatever_comes_in_its_place_is_read_without_an_error(data: bytes) -> None:
    can_link.from_netlink(data)
    can_link.from_netlink(struct.pack("=IHHII", 0, 16, 0, 1, 0) + data)


def test_a_silent_motor_on_a_slow_link_is_not_told_as_a_fault_of_the_cable() -> None:
    world = World()
    world.gripper.power_off()
    world.condition = looked(watch(), SLOW).judged(UP)
    world.run(1.0)
    message = world.client().call("motor.enable")["error"]["message"]
    assert "the motor does not answer, and can0 runs at 0.5 Mbit/s" in message
    assert MEND in message


def test_the_number_of_the_interface_is_known_while_the_link_is_up() -> None:
    watching = looked(watch(), RIGHT)
    assert watching.ifindex == 3
    watching.step(DOWN)
    assert watching.ifindex is None
