"""The emulated adapter without a kernel: USB/IP and gs_usb as bytes, as the kernel writes them."""

import struct
from typing import NamedTuple

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import build_gripper
from tests.vm.gs_usb import (
    BITTIMING,
    BT_CONST,
    DEVICE_CONFIG,
    ERROR_ACTIVE,
    ERROR_BUS_OFF,
    ERROR_FLAG,
    GET_STATE,
    HOST_FORMAT,
    MODE,
    Adapter,
    Identity,
)
from tests.vm.usbip import Endpoints, Handlers

STALL, TAKEN_BACK = -32, -104
READ_MASTER_ID = CanFrame(0x7FF, bytes.fromhex("0800330700000000"))
AT_1_MBIT_S = struct.pack("<5I", 5, 6, 4, 1, 3)
NO_ECHO = 0xFFFF_FFFF
ANY_FRAME = struct.pack("<IIBBBB8s", *[0] * 6, bytes(8))
STARTED, HALTED = struct.pack("<II", 1, 0), struct.pack("<II", 0, 0)


class Answer(NamedTuple):
    """One answer to the host."""

    command: int
    number: int
    status: int
    data: bytes


class Packet(NamedTuple):
    """One frame as the adapter gives it to the host."""

    echo_id: int
    can_id: int
    data: bytes


class Host:
    """What the kernel does with an adapter: requests numbered from 1, answers as they come."""

    def __init__(self) -> None:
        gripper = build_gripper()

        def carry(frame: CanFrame) -> None:
            for answer in gripper.receive(0.0, frame):
                self.adapter.from_bus(answer)

        self.adapter = adapter = Adapter(Identity("LEFT"), carry)
        handlers = Handlers(adapter.control, adapter.from_host, adapter.next_packet)
        self.endpoints = Endpoints(handlers)
        self.number = 0
        self.reading: set[int] = set()

    def submit(self, endpoint: int, length: int, setup: bytes = bytes(8)) -> bytes:
        """Return a CMD_SUBMIT that asks for data."""
        self.reading.add(self.number + 1)
        return self._submit(1, endpoint, length, setup)

    def submit_data(self, endpoint: int, data: bytes, setup: bytes = bytes(8)) -> bytes:
        """Return a CMD_SUBMIT that brings data."""
        return self._submit(0, endpoint, len(data), setup) + data

    def _submit(self, direction: int, endpoint: int, length: int, setup: bytes) -> bytes:
        self.number += 1
        header = (1, self.number, 0x10001, direction, endpoint, 0, length, 0, 0, 0, setup)
        return struct.pack(">5I I4i 8s", *header)

    def feed(self, data: bytes) -> list[Answer]:
        """Send bytes; return the answers that come at once."""
        output, found = self.endpoints.feed(data), []
        while output:
            command, number, _, _, _, status, length = struct.unpack_from(">5I ii", output)
            size = 48 + (length if command == 3 and number in self.reading else 0)
            found.append(Answer(command, number, status, output[48:size]))
            output = output[size:]
        return found

    def ask(self, kind: int, request: int, length: int, value: int = 0) -> Answer:
        """Ask the device for something."""
        setup = struct.pack("<BBHHH", kind, request, value, 0, length)
        (answer,) = self.feed(self.submit(0, length, setup))
        return answer

    def tell(self, request: int, data: bytes) -> Answer:
        """Tell the adapter something."""
        setup = struct.pack("<BBHHH", 0x41, request, 0, 0, len(data))
        (answer,) = self.feed(self.submit_data(0, data, setup))
        return answer

    def start(self, timing: bytes = AT_1_MBIT_S) -> None:
        """Set the bit rate and start, as when the interface is set up."""
        assert self.tell(BITTIMING, timing).status == 0
        assert self.tell(MODE, STARTED).status == 0

    def send(self, frame: CanFrame, echo_id: int = 3) -> None:
        """Send a frame; USB takes it, whatever becomes of it."""
        words = (echo_id, frame.can_id, len(frame.data), 0, 0, 0, frame.data)
        (answer,) = self.feed(self.submit_data(2, struct.pack("<IIBBBB8s", *words)))
        assert (answer.status, answer.data) == (0, b"")

    def packets(self) -> list[Packet]:
        """Ask for packets; return those that are there, and take the other requests back."""
        asked = b"".join(self.submit(1, 64) for _ in range(9))
        found = self.feed(asked)
        for number in range(self.number - 9 + len(found), self.number):
            (answer,) = self.feed(unlink(number + 1))
            assert answer.status == TAKEN_BACK
        frames = [struct.unpack("<IIBBBB8s", answer.data) for answer in found]
        return [Packet(echo_id, can_id, data[:dlc]) for echo_id, can_id, dlc, *_, data in frames]


def unlink(number: int) -> bytes:
    """Return a CMD_UNLINK, with 99 as its own number."""
    return struct.pack(">5I I 24x", 2, 99, 0x10001, 1, 1, number)


def started() -> Host:
    host = Host()
    host.start()
    return host


def test_the_kernel_reads_which_device_it_is() -> None:
    host = Host()
    device = host.ask(0x80, 6, 64, value=0x0100).data
    assert struct.unpack_from("<HH", device, 8) == (0x1D50, 0x606F)
    assert device[0] == len(device) == 18
    short = host.ask(0x80, 6, 9, value=0x0200).data
    whole = host.ask(0x80, 6, struct.unpack_from("<H", short, 2)[0], value=0x0200).data
    assert (short, len(whole)) == (whole[:9], 32)
    assert [whole[20], whole[27]] == [0x81, 0x02]
    serial = host.ask(0x80, 6, 255, value=0x0300 | device[16]).data
    assert serial[2:].decode("utf-16-le") == "LEFT"


def test_its_driver_is_told_of_one_channel_that_can_1_mbit_s() -> None:
    host = Host()
    assert host.tell(HOST_FORMAT, struct.pack("<I", 0xBEEF)).status == 0
    assert host.ask(0xC1, DEVICE_CONFIG, 12).data[3] == 0
    feature, clock_hz, *_ = struct.unpack("<10I", host.ask(0xC1, BT_CONST, 40).data)
    assert clock_hz == 48_000_000
    assert not feature & 1 << 4, "time stamps are not offered, so no frame has one"
    host.start()
    assert host.adapter.bitrate == 1_000_000


def test_what_is_not_known_stalls_and_the_next_request_is_answered() -> None:
    host = Host()
    assert host.ask(0xC1, 77, 4) == Answer(3, 1, STALL, b"")
    assert host.tell(77, b"")[2] == STALL
    assert host.ask(0x80, 6, 255, value=0x0600).status == STALL
    assert host.ask(0xC1, DEVICE_CONFIG, 12).status == 0


def test_a_frame_comes_back_once_sent_and_the_motor_answers_behind_it() -> None:
    host = started()
    host.send(READ_MASTER_ID, echo_id=7)
    echo, answer = host.packets()
    assert echo == Packet(7, READ_MASTER_ID.can_id, READ_MASTER_ID.data)
    assert answer.echo_id == NO_ECHO
    assert (answer.can_id, answer.data[3]) == (0x18, 0x07)


def test_a_waiting_transfer_is_answered_when_there_is_a_frame() -> None:
    host = started()
    assert host.feed(host.submit(1, 64)) == []
    waiting = host.number
    first, second = host.feed(host.submit_data(2, ANY_FRAME))
    assert (first.number, second.number) == (host.number, waiting)


def test_pieces_of_requests_are_put_together() -> None:
    host = started()
    data = host.submit_data(2, ANY_FRAME)
    found = [answer for byte in data for answer in host.feed(bytes((byte,)))]
    assert [answer.number for answer in found] == [host.number]


def test_the_host_takes_a_waiting_transfer_back() -> None:
    host = started()
    host.feed(host.submit(1, 64))
    waiting = host.number
    assert host.feed(unlink(waiting)) == [Answer(4, 99, TAKEN_BACK, b"")]
    assert host.feed(unlink(waiting)) == [Answer(4, 99, 0, b"")], "it is not there any more"
    host.send(READ_MASTER_ID)
    assert len(host.packets()) == 2, "nothing went to the one that was taken back"


def test_before_it_is_started_nothing_goes_either_way() -> None:
    host = Host()
    host.send(READ_MASTER_ID)
    host.adapter.from_bus(READ_MASTER_ID)
    assert host.packets() == []


def test_shorted_wires_end_in_bus_off_until_it_is_started_anew() -> None:
    host = started()
    host.adapter.shorted = True
    host.send(READ_MASTER_ID)
    kinds = [packet.can_id for packet in host.packets()]
    assert kinds == [ERROR_FLAG | 0x04, ERROR_FLAG | 0x04, ERROR_FLAG | ERROR_BUS_OFF]
    assert struct.unpack("<3I", host.ask(0xC1, GET_STATE, 12).data) == (3, 0, 255)
    host.adapter.shorted = False
    host.send(READ_MASTER_ID)
    assert host.packets() == [], "wires that are mended bring no bus back"
    host.tell(MODE, HALTED)
    host.start()
    assert host.adapter.state == ERROR_ACTIVE
    host.send(READ_MASTER_ID)
    assert [packet.echo_id for packet in host.packets()] == [3, NO_ECHO]


def test_another_bit_rate_than_the_motors_ends_in_bus_off() -> None:
    host = Host()
    host.start(struct.pack("<5I", 6, 6, 3, 1, 6))
    assert host.adapter.bitrate == 500_000
    host.send(READ_MASTER_ID)
    assert host.packets()[-1].can_id == ERROR_FLAG | ERROR_BUS_OFF


def test_an_error_on_the_bus_is_told_and_harms_nothing() -> None:
    host = started()
    host.adapter.report_error()
    (packet,) = host.packets()
    assert packet == Packet(NO_ECHO, ERROR_FLAG | 0x88, bytes((0, 0, 4, 0, 0, 0, 0, 0)))
    host.send(READ_MASTER_ID)
    assert [packet.echo_id for packet in host.packets()] == [3, NO_ECHO]


def test_unplugged_it_forgets_its_settings() -> None:
    host = started()
    host.send(READ_MASTER_ID)
    host.adapter.unplug()
    assert (host.packets(), host.adapter.bitrate) == ([], 0)
